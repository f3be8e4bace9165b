"""What the figure of a ranking shows."""

import pytest

from jcontour.app.files.results.ranked_result import Candidate, Ranked, RankedResult
from jcontour.app.files.results.run_metrics import MachineSummary
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports.figures.tuning.ranking import ranking_figure


def row(label, held_out, **others):
    candidate = Candidate(controller=label, preview=5, terminal="output")
    errors = {"a": held_out / 2, "b": held_out * 2}
    return Ranked(
        candidate=candidate, label=label, held_out=held_out, held_out_errors=errors, **others
    )


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
    failed = Ranked(candidate=row("x", 1.0).candidate, label="failed", failure="why")
    assert not drawn([failed]).patches
