import numpy as np
import pytest

from jcontour.linear.continuous_axes import position_axis, sampled_machine, speed_axis
from tuning.identification.step_response import fit_step

DT = 1e-3


def recorded(axis, control):
    plant, late = sampled_machine([axis], DT)
    u = np.concatenate([np.zeros(late), control])[: len(control)]
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    x, y = np.zeros(len(A)), []
    for value in u:
        y.append((C @ x).item())
        x = A @ x + B[:, 0] * value
    return np.array(y)


@pytest.mark.parametrize("takes", ["speed", "position"])
@pytest.mark.parametrize("late", [0.0, 2.0, 3.4])
def test_numbers_of_a_clean_step_come_back(takes, late):
    axis = (speed_axis if takes == "speed" else position_axis)(0.8e-3, 0.017, late * DT)
    control = np.where(np.arange(400) < 50, 0.0, 20.0)
    found = fit_step(control, 0.3 + recorded(axis, control), DT, takes)
    assert found.gain == pytest.approx(0.8e-3, rel=1e-4)
    assert found.time_constant == pytest.approx(0.017, rel=1e-3)
    assert found.delay == pytest.approx(late * DT, abs=2e-6)
    assert found.explained > 1 - 1e-9


def test_counts_leave_the_numbers_within_a_few_per_cent():
    control = np.where(np.arange(600) % 200 < 100, 20.0, -20.0)
    y = recorded(speed_axis(1e-3, 0.02, 2 * DT), control)
    found = fit_step(control, 5e-6 * np.round(y / 5e-6), DT, "speed")
    assert found.gain == pytest.approx(1e-3, rel=0.01)
    assert found.time_constant == pytest.approx(0.02, rel=0.03)
    assert found.delay == pytest.approx(2 * DT, abs=0.1 * DT)
    assert 1e-6 < found.residual < 3e-6  # about a count over the root of twelve


def test_bad_records_are_told():
    step = np.where(np.arange(100) < 20, 0.0, 1.0)
    for control, position, words in (
        (step[:10], step[:10], "needs at least 20 samples"),
        (np.ones(100), step, "control: it never changes"),
        (step, np.zeros(100), "position: it never changes"),
        (step, np.where(step > 0, np.nan, 0.0), "position: needs finite numbers"),
        (step, -np.cumsum(step), "it falls where the control rises"),
    ):
        with pytest.raises(ValueError, match=words):
            fit_step(control, position, DT, "speed")
