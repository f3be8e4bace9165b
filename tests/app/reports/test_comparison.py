"""Runs side by side: which numbers are ranked, and what is told where they are not."""

import json
import math
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import ContourRead, MachineSummary
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.tuned_result import TunedContour
from jcontour.app.files.results.verdict import Verdict, reason
from jcontour.app.files.run_folder import SETTINGS, RunError
from jcontour.app.reports.comparison import comparison, is_comparable, show_comparison
from tests.app import small_runs


def made(
    value,
    error="contour",
    machine="lathe",
    contour="circle",
    unit="A",
    radius=1e-3,
    period=1e-3,
    feed_law="constant 377 mm/min",
    duration=1.0,
    against=(),
):
    read = ContourRead(1, 2 * math.pi * radius, duration, (-radius, -radius), (radius, radius))
    tuned = TunedContour(
        name=contour,
        training=True,
        samples=5,
        metrics={"tuned": small_runs.family_metrics(value)},
        read=read,
        feed_law=feed_law,
    )
    return small_runs.tuned_result(
        machine=MachineSummary(machine, unit, ("X", "Y"), "counts"),
        error=error,
        weights={"alpha": 1e6 * value, "beta": 1.0},
        contours=[tuned],
        sample_period=period,
        verdict=Verdict.of([], [reason(line) for line in against]),
    )


@pytest.fixture
def stored(tmp_path):
    def store(value, command="tune", **others):
        folder = tmp_path / f"run-{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        settings = {"command": command, "flags": {"out": str(folder)}, "versions": {}}
        (folder / SETTINGS).write_text(json.dumps(settings))
        result = made(value, **others)
        if command == "simulate":
            (contour,) = result.contours
            plants = [small_runs.run_metrics(size) for size in (value, 5 * value)]
            result = SimulatedResult(
                machine=result.machine,
                controller="linear-cascade",
                weights={"kp": 1.0},
                error=result.error,
                contour=contour.name,
                feed_law=contour.feed_law,
                samples=5,
                preview=0,
                plants=dict(zip(("nominal", "late"), plants, strict=True)),
                read=contour.read,
                verdict=result.verdict,
                sample_period=result.sample_period,
            )
        write_result(folder, result)
        return folder

    return store


def least(found, name="RMS contour error um", plant="worst"):
    return next(one.least for one in found.numbers if (one.name, one.plant) == (name, plant))


def test_the_least_of_three_runs_is_named_and_what_differs_is_told(stored):
    found = comparison([stored(2e-6), stored(1e-6), stored(3e-6)])
    assert least(found) == "2" and found.differing == {"alpha": pytest.approx([2.0, 1.0, 3.0])}
    assert not found.warnings
    text = StringIO()
    show_comparison(found, Console(file=text, width=200))
    row = next(line for line in text.getvalue().splitlines() if "worst" in line)
    assert row.split()[-4:] == ["2", "1", "3", "2"]
    alike = comparison([stored(2e-6), stored(2.001e-6)])
    assert least(alike) == "same"


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"radius": 2e-3}, "circle: not the same path"),
        ({"feed_law": "jerk-limited, 377 mm/min"}, "circle: not the same motion"),
        ({"duration": 1.01}, "circle: not the same motion"),
        ({"machine": "mill"}, "different machines, lathe, mill"),
    ],
)
def test_errors_along_another_path_or_motion_or_machine_are_not_ranked(stored, changes, why):
    found = comparison([stored(1e-6), stored(2e-6, **changes)])
    assert not any(one.least for one in found.numbers if "error" in one.name)
    assert any(why in line for line in found.warnings)


def test_a_sample_and_a_half_of_time_or_an_unknown_law_is_no_other_motion(stored):
    assert least(comparison([stored(1e-6), stored(2e-6, duration=1.0015)])) == "1"
    assert least(comparison([stored(1e-6), stored(2e-6, feed_law="")])) == "1"
    assert least(comparison([stored(1e-6), stored(2e-6, duration=None)])) == "1"


def test_controls_are_ranked_in_one_unit_and_their_changes_in_one_sample_period(stored):
    control, increment = "RMS control", "RMS control increment"
    found = comparison([stored(1e-6), stored(2e-6, unit="mm/s")])
    assert least(found) == "1" and not least(found, control) and not least(found, increment)
    assert any("controls are in A, mm/s" in line for line in found.warnings)
    found = comparison([stored(1e-6), stored(2e-6, period=5e-4)])
    assert least(found, control) == "1" and not least(found, increment)
    assert found.differing["sample period ms"] == [1.0, 0.5]


def test_a_run_that_must_not_be_used_or_that_diverged_is_never_the_least(stored):
    good, bad = stored(2e-6), stored(1e-6, against=["speed of X EXCEEDS"])
    assert least(comparison([good, bad])) == "1" and least(comparison([bad, bad])) == "same"
    assert least(comparison([bad, stored(3e-6, against=["late"])])) == ""
    assert least(comparison([stored(float("nan")), good])) == "2"


def test_a_single_axis_has_no_contour_error(stored):
    found = comparison([stored(1e-6, error="tracking"), stored(2e-6, error="tracking")])
    names = {one.name for one in found.numbers if one.plant}
    assert names and not any("contour" in name for name in names)


def test_simulated_runs_are_compared_nominal_and_worst_with_their_cycle_times(stored):
    quick = {"duration": 1.2, "command": "simulate"}
    found = comparison([stored(1e-6, command="simulate"), stored(2e-6, **quick)])
    rows = {(one.plant, one.name): one for one in found.numbers}
    assert rows["nominal", "RMS contour error um"].values == pytest.approx([1.0, 2.0])
    assert rows["worst", "RMS contour error um"].values == pytest.approx([5.0, 10.0])
    assert rows["", "cycle time s"].values == [1.0, 1.2] and rows["", "cycle time s"].least == "1"
    assert not least(found)  # errors along another motion say nothing


def test_runs_without_a_common_contour_are_told(stored):
    found = comparison([stored(1e-6), stored(2e-6, contour="square")])
    assert any("no contour in common" in line for line in found.warnings)
    assert not any(one.contour for one in found.numbers)


def test_runs_of_other_commands_are_not_compared(stored, tmp_path):
    run, simulated = stored(1e-6), stored(1e-6, command="simulate")
    assert is_comparable([run, run]) and not is_comparable([run, simulated])
    with pytest.raises(RunError, match="is not a run folder"):
        is_comparable([run, tmp_path / "none"])
    damaged = replace(made(1e-6), contours=[])
    write_result(run, damaged)
    assert comparison([run, run]).numbers[-1].name == "delay samples"
