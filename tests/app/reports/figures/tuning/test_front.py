"""What the figure of a front shows."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.files.results.front_result import BudgetPoint, FrontResult, MachineUnits
from jcontour.app.reports.figures.tuning.front import front

POINTS = [
    BudgetPoint(0.1, {"alpha": 2.0}, 5e-6, 9e-6, 0.1, 5e-6, True, False, 1.5),
    BudgetPoint(0.2, {"alpha": 3.0}, 3e-6, 9e-6, 0.15, 3e-6, True, True, 1.8),
    BudgetPoint(0.05, {"alpha": 1.0}, 8e-6, 9e-6, 0.06, 8e-6, False, False, np.inf),
]
RESULT = FrontResult(MachineUnits("A"), "contour", "contouring-lq", ["alpha"], POINTS)


def shown(result):
    (axes,) = front(result).axes
    return axes, {line.get_label(): line.get_xydata().tolist() for line in axes.lines[1:]}


def test_increments_and_errors():
    axes, lines = shown(RESULT)
    assert lines == {
        "tuned for this budget": [[0.1, pytest.approx(5.0)]],
        "budget is slack": [[0.15, pytest.approx(3.0)]],
        "budget not met": [[0.06, pytest.approx(8.0)]],
    }
    assert axes.get_xlabel() == "worst RMS control increment [A per sample]"
    assert axes.get_ylabel() == "worst RMS contour error [um]"


def test_sensitivities_of_stable_loops():
    axes, lines = shown(replace(RESULT, against="sensitivity", nominal_only=True))
    assert lines == {
        "tuned for this budget": [[1.5, pytest.approx(5.0)]],
        "budget is slack": [[1.8, pytest.approx(3.0)]],
    }
    assert axes.get_xlabel() == "largest peak sensitivity Ms"
    assert "the nominal plant" in axes.get_title()
