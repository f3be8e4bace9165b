"""One whole `jcontour learn` on a tiny machine, and what it says of laps that diverge."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.cli import main
from jcontour.app.commands.loops.learn import before, loading, verdict_on
from jcontour.app.files.results.loop_results import LearnedResult, StoredLap
from jcontour.app.files.results.stored import from_json, to_json
from jcontour.app.files.results.verdict import LimitCheck
from jcontour.app.jobs.job import Pace, from_file
from jcontour.app.reports.figures.loops import learning


@pytest.fixture
def result(tour):
    return tour("learn").result(LearnedResult)


def test_every_machine_has_its_laps(result):
    assert [one.name for one in result.machines[:3]] == [
        "linear model",
        "linear model, encoder noise",
        "nominal",
    ]
    assert len(result.machines) == 6 and result.laps == 6
    for one in result.machines:
        assert len(one.tool_um) == len(one.measured_um) == len(one.control) == 6
        assert one.best_um == one.tool_um[one.pays_until - 1] <= 1.05 * min(one.tool_um)


def test_the_linear_model_has_its_error_measured_and_noise_adds_to_it(result):
    model, noise = result.machines[:2]
    np.testing.assert_allclose(model.tool_um, model.measured_um, rtol=1e-12)
    assert noise.tool_um != noise.measured_um and result.noise_um > 0


def test_what_is_expected_happens(result):
    """The gains change along the part: there is an estimate, and nothing is assured."""
    assert result.ratio < 1 and not result.proven and not result.assured
    for one in result.machines:
        assert one.diverged is None and one.tool_um[-1] < one.tool_um[0]
    text = " ".join(before(result))
    assert "no bound" in text and result.ratio_member in text


def test_learning_reaches_the_noise(result):
    """What is left is what the model leaves at its corners, and at most twice the noise."""
    model, noise = result.machines[:2]
    assert noise.tool_um[-1] < np.hypot(min(model.tool_um), 2 * result.noise_um)


def test_what_a_control_loads_is_the_shifted_reference(tour, result):
    """A lap ends where the tool has settled: the last point is held, and the shift goes on."""
    best = result.stored
    assert best is not None and best.lap == 1 + int(np.argmin(result.machines[0].tool_um))
    assert best.error_um == pytest.approx(min(result.machines[0].tool_um), rel=1e-12)
    rows = np.loadtxt(tour("learn").folder / "reference.csv", delimiter=",", skiprows=1)
    machine = machine_named("machine.json")
    job = from_file(Path("part.ngc"), Pace(machine, None, None))
    place = 1e3 * np.asarray(job.reference(machine.model.dt, 0).position)
    assert job.samples < len(rows) == len(place) == result.samples
    np.testing.assert_allclose(rows[:, 1:3], place, atol=1e-3 * best.largest_um + 1e-9)
    speeds = 1e-3 * np.diff(rows[:, 1:3], axis=0) / np.diff(rows[:, :1], axis=0)
    assert np.abs(speeds).max() == pytest.approx(best.speed, rel=1e-3)


def test_what_asks_for_too_much_or_helps_nothing_is_not_loaded(result):
    fields = to_json(result)
    one = {"lap": 3, "error_um": 1.0, "largest_um": 9.0, "first_um": 0.0, "speed": 0.2}
    limit = LimitCheck(name="acceleration of X", value=7.0, allowed=4.0)
    stored = from_json({**one, "acceleration": 7.0, "limits": [to_json(limit)]}, StoredLap)
    verdict = verdict_on([], stored)
    assert verdict.exit_code == 3 and verdict.reasons[0].startswith("acceleration of X EXCEEDS")
    refused = replace(result, stored=stored, verdict=verdict)
    (line,) = loading(refused, "reference.csv")
    assert line.startswith("nothing: reference.csv is not written")
    fields.pop("stored", None)
    (line,) = loading(from_json(fields, LearnedResult), "reference.csv")
    assert line.startswith("nothing: no lap")


def test_the_figure_has_a_curve_for_every_machine(result):
    (axes,) = learning(result).axes
    assert len(axes.lines) == len(result.machines) + 1
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), result.machines[0].tool_um)


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--laps", "0"], "laps: needs to be at least 1, received 0"),
        (["--smoothing", "-1"], "smoothing: needs to be at least 0"),
        (["--effort", "0"], "effort: needs to be above zero"),
    ],
)
def test_bad_input_is_one_line(capsys, flags, says):
    assert main(["learn", *flags]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said and "\n" not in said
