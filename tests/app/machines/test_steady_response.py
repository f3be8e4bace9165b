"""Against transfer functions at s = 0, and against runs of the model."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from jcontour.app.machines.steady_response import steady_response
from jcontour.linear.continuous_axes import (
    force_axis,
    position_axis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay


@pytest.mark.parametrize("mass", [2.0, 180.0, 2e3])  # the last needs half an hour to settle
def test_a_slide_with_viscous_friction_goes_at_force_over_friction(mass):
    axis = force_axis(gain=31.0, mass=mass, viscous=5.0, delay=0.6e-3)
    other = speed_axis(2.0, 0.01)
    model = with_input_delay(sampled_machine([axis, other], 1e-3)[0], 3)
    found = steady_response(model, 0)
    assert found.kind == "speed" and found.gain == pytest.approx(31.0 / 5.0, rel=1e-8)
    assert found.slowest == pytest.approx(mass / 5.0 / 1e-3, rel=1e-6)
    assert steady_response(model, 1).gain == pytest.approx(2.0, rel=1e-10)


def test_drives_settle_as_their_transfer_function_says():
    soft = with_resonance(force_axis(10.0, 5.0), 2 * np.pi * 40, 0.02)
    place = with_resonance(position_axis(0.7, 0.004), 2 * np.pi * 60, 0.05)
    model, _ = sampled_machine([soft, place, speed_axis(3.0, 0.0, 1e-3)], 1e-3)
    found = [steady_response(model, axis) for axis in range(3)]
    assert [one.kind for one in found] == ["acceleration", "position", "speed"]
    assert [one.gain for one in found] == pytest.approx([2.0, 0.7, 3.0], rel=1e-6)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_states_that_are_mixed_settle_where_a_long_run_ends(seed):
    """States of both axes in other coordinates, where no zero of A tells the axes apart."""
    random = np.random.default_rng(seed)
    axes = [with_resonance(speed_axis(0.5, 0.03), 200.0, 0.1), position_axis(2.0, 0.01)]
    plain, _ = sampled_machine(axes, 1e-3)
    turn = random.normal(size=(plain.states, plain.states))
    A, B, C = (np.asarray(one) for one in (plain.A, plain.B, plain.C))
    M, columns, rows = turn @ A @ np.linalg.inv(turn), turn @ B, C @ np.linalg.inv(turn)
    for axis, kind in enumerate(("speed", "position")):
        x, y = np.zeros(len(M)), []
        for _ in range(3000):
            x = M @ x + columns[:, axis]
            y.append(rows[axis] @ x)
        ends = {"speed": (y[-1] - y[-2]) / 1e-3, "position": y[-1]}
        found = steady_response(LinearPlant(M, columns, rows, 1e-3), axis)
        assert found.kind == kind and found.gain == pytest.approx(ends[kind], rel=1e-6)


def test_nothing_lasts_of_an_axis_that_runs_away():
    A = block_diag(1.001, 1.0)
    model = LinearPlant(A, np.eye(2), np.eye(2), 1e-3)
    away, sound = steady_response(model, 0), steady_response(model, 1)
    assert away.kind == "nothing" and np.isnan(away.gain)
    assert sound.kind == "speed" and sound.gain == pytest.approx(1e3)
