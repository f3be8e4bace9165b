"""Words of the tables of a tuning run."""

from dataclasses import replace

import pytest

from jcontour.app.files.results.tuned_result import TunedContour
from jcontour.app.reports.run_tables import change_words, limit_words
from tests.app import small_runs

LOST = small_runs.family_metrics(9e-6, diverged=True)


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
    contours = [
        TunedContour(
            name=name,
            training=name == "part",
            samples=9,
            metrics={
                "start": small_runs.family_metrics(before),
                "tuned": small_runs.family_metrics(after),
            },
        )
        for name, before, after in [("part", 4e-6, 1e-6), ("a", 8e-6, 4e-6), ("b", 16e-6, 2e-6)]
    ]
    result = small_runs.tuned_result(contours=contours)
    assert change_words(result, True) == "part 4 -> 1 um (-75 %)"
    assert change_words(result, False) == "2 held-out contours 16 -> 4 um (-75 % in the mean)"
    lost = replace(contours[2], metrics=contours[2].metrics | {"tuned": LOST})
    found = change_words(small_runs.tuned_result(contours=[*contours[:2], lost]), False)
    assert found == "a 8 -> 4 um (-50 %)"
