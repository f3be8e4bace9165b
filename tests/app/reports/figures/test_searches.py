"""Figures of searches show their points."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.files.results.run_metrics import MachineSummary
from jcontour.app.files.results.search_results import (
    BudgetPoint,
    FrontResult,
    Ranked,
    RankedResult,
)
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports.figures.searches import (
    FamilyCurves,
    front,
    ranking_figure,
    sensitivity_figure,
)

BUDGETS = [
    BudgetPoint(0.1, {"alpha": 2.0}, 5e-6, 9e-6, 0.1, 5e-6, True, False, 1.5),
    BudgetPoint(0.2, {"alpha": 3.0}, 3e-6, 9e-6, 0.15, 3e-6, True, True, 1.8),
    BudgetPoint(0.05, {"alpha": 1.0}, 8e-6, 9e-6, 0.06, 8e-6, False, False, np.inf),
]
FRONT = FrontResult(
    MachineSummary("mill", "A", ("X", "Y"), "counts"),
    "contour",
    "contouring-lq",
    ["alpha"],
    BUDGETS,
)
HERTZ = np.array([1.0, 10.0, 100.0])


def shown(result):
    (axes,) = front(result).axes
    return axes, {line.get_label(): line.get_xydata().tolist() for line in axes.lines[1:]}


def test_increments_and_errors():
    axes, lines = shown(FRONT)
    assert lines == {
        "tuned for this budget": [[0.1, pytest.approx(5.0)]],
        "budget is slack": [[0.15, pytest.approx(3.0)]],
        "budget not met": [[0.06, pytest.approx(8.0)]],
    }
    assert axes.get_xlabel() == "worst RMS control increment [A per sample]"
    assert axes.get_ylabel() == "worst RMS contour error [um]"


def test_sensitivities_of_stable_loops():
    axes, lines = shown(replace(FRONT, against="sensitivity", nominal_only=True))
    assert lines == {
        "tuned for this budget": [[1.5, pytest.approx(5.0)]],
        "budget is slack": [[1.8, pytest.approx(3.0)]],
    }
    assert axes.get_xlabel() == "largest peak sensitivity Ms"
    assert "the nominal plant" in axes.get_title()


def row(label, held_out, **others):
    errors = {"a": held_out / 2, "b": held_out * 2}
    return Ranked(label=label, held_out=held_out, held_out_errors=errors, **others)


def drawn(rows):
    machine = MachineSummary("table", "A", ("X", "Y"), "encoders")

    result = RankedResult(
        machine=machine, error="contour", evaluations=40, rows=rows, verdict=Verdict.of([])
    )
    (axes,) = ranking_figure(result).axes
    return axes


def test_bars_are_geometric_means_and_dots_are_contours():
    axes = drawn([row("best", 2e-6, feasible=True), row("beyond", 1e-6, failure=None)])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["beyond", "best"]
    widths = {bar.get_y() + 0.3: bar.get_width() for bar in axes.patches}
    assert widths == {1.0: pytest.approx(2.0), 0.0: pytest.approx(1.0)}
    dots = axes.lines[-1].get_xydata().tolist()
    assert sorted(dots) == [[0.5, 0], [1.0, 1], [2.0, 0], [4.0, 1]]


def test_failures_have_no_bar():
    failed = Ranked(label="failed", failure="why")
    assert not drawn([failed]).patches


def test_the_largest_of_every_design_and_the_bound_are_drawn():
    start = np.array([[0.1, 3.0, 1.0], [0.2, 2.0, 1.1], [np.nan, np.nan, np.nan]])
    tuned = np.array([[0.1, 1.5, 1.0], [0.05, 1.9, 1.0]])
    curves = {"start": FamilyCurves(HERTZ, start), "tuned": FamilyCurves(HERTZ, tuned)}
    drawn = sensitivity_figure(curves, 2.0).axes[0].get_lines()
    heights = {line.get_label(): np.asarray(line.get_ydata()).tolist() for line in drawn}
    assert heights["start, largest of the family"] == [0.2, 3.0, 1.1]
    assert heights["tuned, largest of the family"] == [0.1, 1.9, 1.0]
    assert heights["start: 1 of 3 plants not stable, not drawn"] == []
    assert heights["limit 2"] == [2.0, 2.0]


def test_no_stable_plant_and_no_bound():
    curves = {"start": FamilyCurves(HERTZ, np.full((2, 3), np.nan))}
    labels = [line.get_label() for line in sensitivity_figure(curves, None).axes[0].get_lines()]
    assert [name for name in labels if not name.startswith("_")] == [
        "start: 2 of 2 plants not stable, not drawn"
    ]
