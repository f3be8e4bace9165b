"""`front` on a small machine, from the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from experiments.cli import main
from experiments.commands import front as command_front
from experiments.commands.front import (
    BudgetPoint,
    FrontResult,
    MachineUnits,
    next_steps,
    search_of,
    show,
)
from experiments.files.netcdf import load_dataset
from experiments.files.results import from_json, read_result, to_json
from experiments.options import Front
from experiments.reports.front_figure import Spent, front
from experiments.reports.tables import console_of


@pytest.fixture(scope="module")
def flags(machine_file, part_file):
    """A front of two budgets that is quick to trace."""
    unbounded = ["--max-sensitivity", "None"]  # the increment alone is limited here
    return [
        str(part_file),
        "--plant",
        str(machine_file),
        "--points",
        "2",
        "--preview",
        "4",
        *unbounded,
    ]


@pytest.fixture(scope="module")
def traced(tmp_path_factory, flags):
    folder = tmp_path_factory.mktemp("front") / "run"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(command_front, "EFFORT", replace(command_front.EFFORT, starts=2, scatter=4))
        assert main(["front", *flags, "--out", str(folder)]) == 0
    return folder


def test_every_file_is_there(traced):
    assert {path.name for path in traced.iterdir()} == {
        "settings.json",
        "inputs",
        "budgets.json",
        "without-budget",
        "budget-0",
        "budget-1",
        "front.nc",
        "front.png",
        "result.json",
    }


def test_default_budgets_bite(traced):
    """The largest is what the best weights need; a smaller one costs error."""
    result = read_result(traced, FrontResult)
    tight, loose = result.points
    assert tight.budget == pytest.approx(loose.budget * 3 / 4)
    assert tight.rms_increment == pytest.approx(tight.budget, rel=1e-3)
    assert not tight.slack
    for point in result.points:
        assert point.feasible
        assert point.rms_increment <= point.budget * (1 + 1e-6)
    assert tight.rms_contour_error > 1.05 * loose.rms_contour_error
    # other weights may reach the error of the search without a budget with less increment
    assert set(result.slack) <= {loose.budget}


def test_a_machine_that_stands_still_is_no_answer(traced):
    """It has no contour error; the tracking error is capped where no flag does."""
    result = read_result(traced, FrontResult)
    assert result.tracking_cap is not None
    for point in result.points:
        assert point.rms_tracking_error <= result.tracking_cap * (1 + 1e-6)
    assert next_steps(result)[0].startswith("The RMS tracking error is held below ")


def test_the_netcdf_file_holds_the_points(traced):
    points = read_result(traced, FrontResult).points
    dataset = load_dataset(traced / "front.nc")
    np.testing.assert_array_equal(dataset.budget, [point.budget for point in points])
    for name in ("rms_contour_error", "rms_increment", "objective"):
        if name in dataset:
            np.testing.assert_array_equal(dataset[name], [getattr(p, name) for p in points])
    assert dataset.rms_contour_error.attrs["units"] == "m"


def test_a_finished_front_can_be_told_again(traced, capsys):
    before = json.loads((traced / "result.json").read_text())
    assert main(["front", "--resume", str(traced), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {"run": str(traced), **before}


POINTS = [
    BudgetPoint(0.1, {"alpha": 2.0}, 5e-6, 9e-6, 0.1, 5e-6, True, False),
    BudgetPoint(0.2, {"alpha": 3.0}, 3e-6, 9e-6, 0.15, 3e-6, True, True),
    BudgetPoint(0.05, {"alpha": 1.0}, 8e-6, 9e-6, 0.06, 8e-6, False, False),
]
RESULT = FrontResult(MachineUnits("A"), "contour", "contouring-lq", ["alpha"], POINTS)


def test_weights_stand_beside_the_metrics_in_json():
    written = to_json(RESULT)
    assert list(written["points"][0])[:3] == ["budget", "alpha", "rms_contour_error"]
    assert from_json(written, FrontResult) == RESULT


def test_a_slack_budget_is_said(capsys):
    show(RESULT, console_of())
    (row,) = [line for line in capsys.readouterr().out.splitlines() if line.strip()[:3] == "0.2"]
    assert row.split() == ["0.2", "0.15", "3", "3", "yes", "no"]
    slack, following = next_steps(RESULT)
    assert slack.startswith("Slack: the best weights found need less than the budget 0.2.")
    assert "jcontour tune --max-rms-increment 0.1 " in following


def test_the_figure_shows_increments_and_errors():
    spent = [Spent(p.rms_increment, p.error("contour"), p.feasible, p.slack) for p in POINTS]
    (axes,) = front(spent, "contour", "A").axes
    shown = {line.get_label(): line.get_xydata().tolist() for line in axes.lines[1:]}
    assert shown == {
        "tuned for this budget": [[0.1, pytest.approx(5.0)]],
        "budget is slack": [[0.15, pytest.approx(3.0)]],
        "budget not met": [[0.06, pytest.approx(8.0)]],
    }
    assert axes.get_ylabel() == "worst RMS contour error [um]"


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (Front(points=0), "points needs at least 1"),
        (Front(max_rms_increment=1.0), "leave it out"),
        (Front(least_increment=0.0), "least-increment: needs to be finite and above zero"),
        (Front(most_increment=float("inf")), "most-increment: needs to be finite"),
    ],
)
def test_bad_flags_are_named(flags, says):
    with pytest.raises(ValueError, match=says):
        search_of(flags)


def test_budgets_in_the_wrong_order_are_named(flags, tmp_path, capsys):
    order = ["--least-increment", "2", "--most-increment", "1", "--out", str(tmp_path / "run")]
    assert main(["front", *flags, *order]) == 2
    assert "least-increment: 2 is above the largest budget, 1" in capsys.readouterr().err
