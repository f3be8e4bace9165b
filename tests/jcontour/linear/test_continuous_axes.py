import jax
import numpy as np
import pytest
from scipy.signal import lsim

from jcontour.linear.continuous_axes import (
    force_axis,
    position_axis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from jcontour.linear.transformations import with_input_delay

DT = 1e-3
W = np.array([1.0, 30.0, 400.0])


def test_responses_are_those_of_the_transfer_functions():
    s = 1j * W
    late = np.exp(-0.002 * s)
    wanted = {
        "speed": (speed_axis(0.5, 0.02, 0.002), 0.5 * late / (s * (0.02 * s + 1))),
        "plain": (speed_axis(0.5), 0.5 / s),
        "position": (position_axis(1.2, 0.01, 0.002), 1.2 * late / (0.01 * s + 1)),
        "force": (force_axis(35.0, 95.0, 203.0), 35.0 / (95.0 * s**2 + 203.0 * s)),
    }
    for axis, value in wanted.values():
        assert np.allclose(axis.response(W), value, rtol=1e-12)
    soft = with_resonance(speed_axis(0.5, 0.02), 300.0, 0.05)
    mode = 300.0**2 / (s**2 + 2 * 0.05 * 300.0 * s + 300.0**2)
    assert np.allclose(soft.response(W), mode * 0.5 / (s * (0.02 * s + 1)), rtol=1e-12)


@pytest.mark.parametrize("late", [0.0, 0.3, 1.0, 2.6])
def test_the_sampled_machine_is_where_the_continuous_one_is(late):
    """A fine integration of the delayed, held control is the other computation."""
    axis = with_resonance(speed_axis(0.5, 0.02, late * DT), 300.0, 0.05)
    u = np.random.default_rng(0).normal(size=60)
    plant, shared = sampled_machine([axis], DT)
    plant = with_input_delay(plant, shared)
    C, step = np.asarray(plant.C), jax.jit(lambda x, u: plant.step(x, u))
    x, actual = np.zeros(plant.states), []
    for value in u:
        actual.append((C @ x).item())
        x = np.asarray(step(x, np.array([value])))
    fine = 50
    time = DT / fine * np.arange(60 * fine)
    held = np.zeros(time.size)
    steps = np.floor((time - late * DT) / DT + 1e-9).astype(int)
    held[steps >= 0] = u[steps[steps >= 0]]
    _, y, _ = lsim((axis.A, axis.B, axis.C, [[0.0]]), held, time, interp=False)
    assert np.allclose(actual, y[::fine], atol=1e-9 * np.abs(y).max())


def test_axes_share_whole_samples_of_delay_and_keep_the_rest():
    plant, shared = sampled_machine(
        [speed_axis(1.0, delay=2e-3), speed_axis(1.0, delay=3.5e-3)], DT
    )
    assert shared == 2 and plant.states == 1 + 1 + 2  # one whole sample more, and a part
    one, both = sampled_machine([speed_axis(1.0, 0.02), position_axis(1.0, 0.02)], DT)
    assert both == 0 and one.axes == one.inputs == 2
    A = np.asarray(one.A)
    assert A[0, 0] == 1.0 and A[2, 2] == pytest.approx(np.exp(-0.05))


def test_bad_numbers_are_told():
    for make, words in (
        (lambda: speed_axis(0.0), "gain: needs to be above zero"),
        (lambda: speed_axis(1.0, -1.0), "time_constant: needs to be finite and at least zero"),
        (lambda: position_axis(1.0, 0.0), "time_constant: a position drive needs one"),
        (lambda: force_axis(1.0, 0.0), "mass: needs to be above zero"),
        (lambda: with_resonance(speed_axis(1.0), 100.0, 0.0), "resonance: needs a frequency"),
        (lambda: sampled_machine([], DT), "axes: needs one at least"),
        (lambda: sampled_machine([speed_axis(1.0)], 0.0), "dt: needs to be above zero"),
    ):
        with pytest.raises(ValueError, match=words):
            make()
