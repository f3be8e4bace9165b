"""Words of the tables of a tuning run."""

from dataclasses import replace

import pytest

from jcontour.app.files.results.run_metrics import PeakPlace
from jcontour.app.files.results.tuned_result import DriveLoop, TunedContour
from jcontour.app.reports.run_tables import change_words, limit_words, tuned_answer
from jcontour.app.reports.screen import screen
from tests.app import small_runs

GAINS = ("position", "velocity", "integral_time", "inertia", "viscous", "level")
LOST = small_runs.family_metrics(9e-6, diverged=True)


def contour_of(name, training=False, before=1e-6, after=1e-6, peak=None):
    metrics = {"start": before, "tuned": after}
    each = {key: small_runs.family_metrics(error) for key, error in metrics.items()}
    return TunedContour(name=name, training=training, samples=9, metrics=each, peak=peak)


@pytest.mark.parametrize(
    ("name", "bound", "words"),
    [
        ("rms_tracking_error", 1.25e-4, "rms tracking error <= 125 um"),
        ("peak_sensitivity", 2.0, "peak sensitivity <= 2"),
        ("control_use", 0.97, "control <= 97 % of the machine's limit"),
    ],
)
def test_limits_are_told_in_the_units_of_the_tables(name, bound, words):
    assert limit_words(name, bound) == words


def test_the_change_of_a_set_is_its_worst_error_and_the_mean_of_its_ratios():
    """Errors halve on one contour and fall to an eighth on the other: a quarter in the mean."""
    rows = ("part", True, 4e-6, 1e-6), ("a", False, 8e-6, 4e-6), ("b", False, 16e-6, 2e-6)
    contours = [contour_of(*row) for row in rows]
    result = small_runs.tuned_result(contours=contours)
    assert change_words(result, True) == "part 4 -> 1 um (-75 %)"
    assert change_words(result, False) == "2 held-out 16 -> 4 um (mean -75 %)"
    lost = replace(contours[2], metrics=contours[2].metrics | {"tuned": LOST})
    found = change_words(small_runs.tuned_result(contours=[*contours[:2], lost]), False)
    assert found == "a 8 -> 4 um (-50 %)"


def test_the_part_stands_before_held_out_contours_and_its_place_is_exact_far_away():
    """A millimetre is seen at 10 m, though the held-out contour has the larger error."""
    places = {
        "bracket": PeakPlace("late", 2.58e-6, 0.1, (10.00498, -0.0035), line=12),
        "ellipse": PeakPlace("nominal", 6.987e-6, 0.2, (3e-3, 4e-3)),
    }
    contours = [contour_of(name, name == "bracket", peak=peak) for name, peak in places.items()]
    answer = dict(tuned_answer(small_runs.tuned_result(contours=contours)))
    assert answer["Worst"] == (
        "largest contour error: bracket 2.58 um at X 10004.98, Y -3.5 mm, t 0.1 s, line 12 of the "
        "file (late); held out ellipse 6.987 um"
    )


@pytest.mark.parametrize("few", [True, False])
def test_a_drive_gets_all_gains_or_the_command_that_prints_them(few):
    gains = {"position": 44.93} if few else dict.fromkeys(GAINS, [1057.0, 956.5])
    drive = DriveLoop(controller="p", weights=gains, error=3e-6, tuned_error=1e-6, kept=True)
    result = small_runs.tuned_result(contours=[contour_of("part", True)], drive=drive)
    lines = screen(result.verdict, tuned_answer(result, "runs/a"))
    text = " ".join(" ".join(lines).replace("\\", "").split())
    assert "p, 3 times the tuned error" in text
    assert ("position gain 44.93 1/s (2696 mm/min per mm)" in text) is few
    assert ("jcontour report runs/a --drive general --no-page" in text) is not few
