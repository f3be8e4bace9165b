"""Which numbers of two tuned runs can be compared. Two runs of a command side by side."""

import json
import math
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from jcontour.app.commands.compare import (
    comparable,
    control_units,
    run,
    same_period,
    show,
    unlike_motions,
    unlike_paths,
)
from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import ContourRead, MachineSummary
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.tuned_result import TunedContour
from jcontour.app.files.results.verdict import Verdict, reason
from jcontour.app.files.run_folder import SETTINGS, RunError
from jcontour.app.reports.tables import columns_of
from tests.app import small_runs


def tuned(*contours, unit="V", period=1e-3, name="mill"):
    machine = MachineSummary(name, unit, ("X", "Y"), "counts")
    return small_runs.tuned_result(contours=[*contours], machine=machine, sample_period=period)


def contour(name="circle", length=6.0, duration=1.0, feed_law="constant 360 mm/min"):
    read = ContourRead(1, length, duration, (-1.0, -1.0), (1.0, 1.0))
    return TunedContour(
        name=name, training=True, samples=9, metrics={}, read=read, feed_law=feed_law
    )


def test_a_path_of_another_length_or_box_is_another():
    assert unlike_paths(tuned(contour()), tuned(contour(length=6.0001))) == []
    assert unlike_paths(tuned(contour()), tuned(contour(length=6.1))) == ["circle"]
    assert unlike_paths(tuned(contour()), tuned(contour("square", length=9.0))) == []
    assert unlike_motions(tuned(contour()), tuned(contour(length=6.1, duration=2.0))) == {}


@pytest.mark.parametrize(
    ("changes", "other"),
    [
        ({}, False),
        ({"duration": 1.0015}, False),  # a sample and a half: rounded to whole samples
        ({"duration": 1.01}, True),
        ({"feed_law": "jerk-limited, 360 mm/min"}, True),
        ({"feed_law": ""}, False),
        ({"feed_law": "", "duration": 2.0}, True),
        ({"duration": None}, False),
    ],
)
def test_a_motion_is_its_feed_law_and_its_duration(changes, other):
    found = unlike_motions(tuned(contour()), tuned(contour(**changes)))
    assert bool(found) is other


def test_units_decide_on_controls_and_the_sample_on_their_changes():
    mine, unit, fast = tuned(), tuned(unit="A"), tuned(period=5e-4)
    metrics = ("rms_contour_error", "rms_control", "rms_increment")
    assert [comparable(name, mine, mine) for name in metrics] == [True, True, True]
    assert [comparable(name, mine, unit) for name in metrics] == [True, False, False]
    assert [comparable(name, mine, fast) for name in metrics] == [True, True, False]
    assert same_period(1e-3, 0.001) and not same_period(1e-3, 1.1e-3)


def test_a_unit_without_a_name_is_that_of_one_machine():
    mill, lathe = tuned(unit="control unit"), tuned(unit="control unit", name="lathe")
    assert comparable("rms_control", mill, mill)
    assert not comparable("rms_control", mill, lathe)
    assert control_units(mill, lathe) == ["control unit of mill", "control unit of lathe"]
    assert comparable("rms_control", tuned(), tuned(name="lathe"))


COLUMNS = columns_of("contour")


def made(
    alpha,
    value,
    error="contour",
    machine="lathe",
    contour="circle",
    unit="A",
    radius=1e-3,
    period=1e-3,
    feed_law="constant 377 mm/min",
    duration=1.0,
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
        weights={"alpha": alpha, "beta": 1.0, "rho": 2e-9},
        contours=[tuned],
        sample_period=period,
    )


def stored(folder, alpha, value, command="tune", **others):
    folder.mkdir()
    flags = {"seed": int(alpha), "out": str(folder)}
    settings = {"command": command, "flags": flags, "versions": {}}
    (folder / SETTINGS).write_text(json.dumps(settings))
    write_result(folder, made(alpha, value, **others))
    return folder


def simulated(folder, values, gain=1.0, **others):
    """Run of `simulate` on plants that have these numbers in every metric."""
    tuned = made(1.0, 0.0, **others)
    (contour,) = tuned.contours
    plants = [small_runs.run_metrics(value) for value in values]
    folder.mkdir()
    settings = {"command": "simulate", "flags": {"weights": f"kp={gain}"}, "versions": {}}
    (folder / SETTINGS).write_text(json.dumps(settings))
    result = SimulatedResult(
        machine=tuned.machine,
        controller="linear-cascade",
        weights={"kp": gain},
        error=tuned.error,
        contour=contour.name,
        feed_law=contour.feed_law,
        samples=5,
        preview=0,
        plants=dict(zip(("nominal", "late", "light"), plants, strict=True)),
        read=contour.read,
        verdict=Verdict.of([]),
        sample_period=tuned.sample_period,
    )
    write_result(folder, result)
    return folder


def said(found, width=200):
    text = StringIO()
    show(found, Console(file=text, width=width))
    return text.getvalue()


def test_what_changed_and_which_is_better(tmp_path):
    found = run(stored(tmp_path / "a", 1.0, 1e-6), stored(tmp_path / "b", 2.0, 2e-6))
    assert found.settings == {"seed": [1, 2]} and found.weights["alpha"] == [1.0, 2.0]
    assert found.better == {"first": 2 * len(COLUMNS), "second": 0, "same": 0, "neither": 0}
    text = said(found)
    line = "RMS contour error, worst contour and plant: 1 against 2 um: the first is better."
    assert line in text and "Both may be loaded" in text
    assert "WARNING" not in text


def test_a_path_of_the_same_name_and_another_size_is_told(tmp_path):
    a, b = stored(tmp_path / "a", 1.0, 1e-6), stored(tmp_path / "b", 2.0, 2e-6, radius=2e-3)
    assert run(a, b).unlike == ["circle"] and run(a, a).unlike == []
    text = said(run(a, b))
    assert text.startswith("WARNING: circle: not the same path in both runs")
    row = next(line for line in text.splitlines() if "RMS contour error um" in line)
    assert row.split()[-2:] == ["1", "2"]  # both are shown, neither is called better
    for verdict in ("is better.", "the same.\nPeak", "may be loaded"):
        assert verdict not in text
    assert run(a, b).better == {"first": 0, "second": 0, "same": 0, "neither": 0}


def judged(found):
    """Metrics of which one side is called better, or the same."""
    return {row.metric for row in found.metrics if row.better}


def test_controls_in_other_units_are_not_called_better(tmp_path):
    a, b = stored(tmp_path / "a", 1.0, 1e-6), stored(tmp_path / "b", 2.0, 2e-6, unit="mm/s")
    assert "RMS change of the control" in said(run(a, a)) and len(judged(run(a, a))) == len(COLUMNS)
    found, text = run(a, b), said(run(a, b))
    assert judged(found) == {name for name in COLUMNS if name.endswith("error")}
    assert "1e-06 A per sample against 2e-06 mm/s per sample: not to be compared." in text
    assert "WARNING: controls are in A and in mm/s: not compared" in text
    rows = [line.split() for line in text.splitlines()]
    assert ["control", "unit", "A", "mm/s"] in rows
    assert not [row for row in rows if row[:4] == ["circle", "nominal", "RMS", "control"]]
    assert [row for row in rows if row[:4] == ["circle", "nominal", "RMS", "contour"]]


def test_changes_per_sample_are_not_compared_where_the_samples_differ(tmp_path):
    a, b = stored(tmp_path / "a", 1.0, 1e-6), stored(tmp_path / "b", 2.0, 2e-6, period=5e-4)
    found, text = run(a, b), said(run(a, b))
    assert judged(found) == {name for name in COLUMNS} - {"rms_increment"}
    assert "WARNING: changes of the control are in A per 1 ms and in A per 0.5 ms" in text
    rows = [line.split() for line in text.splitlines()]
    assert ["sample", "period", "ms", "1", "0.5"] in rows


def test_along_another_motion_nothing_is_called_better(tmp_path):
    a = stored(tmp_path / "a", 1.0, 1e-6)
    b = stored(tmp_path / "b", 2.0, 2e-6, feed_law="jerk-limited, 377 mm/min")
    found, text = run(a, b), said(run(a, b))
    assert judged(found) == set() and found.unlike == []
    assert found.motions == {
        "circle": ["constant 377 mm/min, 1 s", "jerk-limited, 377 mm/min, 1 s"]
    }
    assert text.startswith("WARNING: circle: not the same motion in both runs")
    assert "motion of circle" in text and "is better." not in text
    assert "No contour is the same path and motion in both" in text


def test_a_run_that_must_not_be_used_is_never_recommended_nor_called_better(tmp_path):
    a = stored(tmp_path / "a", 1.0, 1e-6)
    write_result(
        a, replace(made(1.0, 1e-6), verdict=Verdict.of([], [reason("speed of X EXCEEDS")]))
    )
    b = stored(tmp_path / "b", 2.0, 2e-6)
    text = said(run(a, b))
    assert "DO NOT USE THESE VALUES\n  because: speed of X EXCEEDS\nsecond:" in text
    assert text.endswith("Only the second may be loaded: `tune` said DO NOT USE of the first.\n")
    assert said(run(a, a)).endswith("Load neither: `tune` said DO NOT USE of both.\n")
    for first, second, smaller in ((a, b, "first"), (b, a, "second")):
        found = run(first, second)
        assert found.better == {"first": 0, "second": 0, "same": 0, "neither": 2 * len(COLUMNS)}
        text = said(found)
        assert f"um: less in the {smaller}, which must not be used." in text
        assert not [line for line in text.splitlines() if "is better." in line]
    worse = stored(tmp_path / "c", 1.0, 3e-6)
    write_result(worse, replace(made(1.0, 3e-6), verdict=Verdict.of([], [reason("late")])))
    found = run(b, worse)  # the other one may be better
    assert found.better["first"] == 2 * len(COLUMNS) and "the first is better." in said(found)


def test_a_run_that_diverged_is_never_better(tmp_path):
    found = run(stored(tmp_path / "a", 1.0, float("nan")), stored(tmp_path / "b", 1.0, 1.0))
    assert found.better == {"first": 0, "second": 2 * len(COLUMNS), "same": 0, "neither": 0}


def test_a_single_axis_has_no_contour_error(tmp_path):
    a = stored(tmp_path / "a", 1.0, 1e-6, error="tracking")
    b = stored(tmp_path / "b", 1.0, 2e-6, error="tracking")
    found = run(a, b)
    names = [name for name in COLUMNS if "contour" not in name]
    assert [row.metric for row in found.metrics] == 2 * names
    assert found.better == {"first": 8, "second": 0, "same": 0, "neither": 0}


def test_runs_of_different_machines_are_told(tmp_path):
    a = stored(tmp_path / "a", 1.0, 1e-6)
    found = run(a, stored(tmp_path / "b", 1.0, 2e-6, machine="mill"))
    text = said(found)
    assert "different machines, lathe and mill" in text
    assert found.better == {"first": 0, "second": 0, "same": 0, "neither": 0}
    assert "is better." not in text and "each on its own machine" in text
    assert "plant: 1 against 2 um, of different machines." in text


def test_runs_without_a_common_contour_are_told(tmp_path):
    a = stored(tmp_path / "a", 1.0, 1e-6)
    found = run(a, stored(tmp_path / "b", 1.0, 2e-6, contour="square"))
    assert found.metrics == [] and "no contour in common" in said(found)


def test_not_a_run(tmp_path):
    a = stored(tmp_path / "a", 1.0, 1e-6)
    with pytest.raises(RunError, match="not a run folder"):
        run(a, tmp_path / "none")
    with pytest.raises(RunError, match="holds a run of 'front', not of 'tune'"):
        run(a, stored(tmp_path / "c", 1.0, 1e-6, command="front"))
    with pytest.raises(RunError, match="holds a run of 'tune', not of 'simulate'"):
        run(simulated(tmp_path / "d", [1e-6] * 3), a)


def test_two_simulated_runs_are_compared_nominal_and_worst(tmp_path):
    a = simulated(tmp_path / "a", [1e-6, 5e-6, 2e-6])
    b = simulated(tmp_path / "b", [2e-6, 3e-6, 4e-6], gain=2.0)
    found = run(a, b)
    rows = {(row.plant, row.metric): row for row in found.metrics}
    assert {metric for _, metric in rows} == {name for name in COLUMNS}
    for name in COLUMNS:
        nominal, worst = rows["nominal", name], rows["worst", name]
        assert (nominal.first, nominal.second, nominal.better) == (1e-6, 2e-6, "first")
        assert (worst.first, worst.second, worst.better) == (5e-6, 4e-6, "second")
    assert found.weights == {"kp": [1.0, 2.0]} and found.margins == {}
    text = said(found)
    assert (
        "RMS contour error, worst contour and plant: 5 against 4 um: the second is better." in text
    )
    assert "may be loaded" not in text  # a simulation recommends no weights


def test_cycle_times_of_simulated_runs_are_compared(tmp_path):
    a = simulated(tmp_path / "a", [1e-6] * 3, duration=1.5)
    found = run(a, simulated(tmp_path / "b", [2e-6] * 3, duration=1.2))
    assert found.cycle_times == {"circle": [1.5, 1.2]} and list(found.motions) == ["circle"]
    text = said(found)
    assert "Cycle time of circle: 1.5 against 1.2 s: the second is quicker." in text
    assert "is better." not in text  # errors along another motion say nothing
    assert "quicker" not in said(run(a, a))
