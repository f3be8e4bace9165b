import jax
import numpy as np
import pytest
from scipy.signal import lfilter

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.wrappers.filters import Biquad, Filtered, low_pass, notch
from jcontour.geometry.contours import circle
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import prepared, simulate

DT = 1e-3


def coefficients(filter):
    return np.asarray(filter.numerator), np.array([1.0, *np.asarray(filter.denominator)])


@pytest.mark.slow
def test_filtered_controls_are_the_filter_of_the_controls(two_axes):
    reference = along(circle(1e-3), 2.5e-5 * np.arange(6), two_axes.dt, 3, at_rest=False)
    inside = ContouringLQ(two_axes, LQWeights(3.0, 5.0, 2e-9), 3)
    filter = low_pass(0.2 / two_axes.dt, 0.7, two_axes.dt)
    rollout = simulate(two_axes, Filtered(inside, filter, 2), reference)
    plan = prepared(inside, reference)
    raw = np.stack(
        [
            inside.step(None, jax.tree.map(lambda leaf, k=k: leaf[k], plan), rollout.state[k])[1]
            for k in range(6)
        ]
    )
    np.testing.assert_allclose(
        rollout.control, lfilter(*coefficients(filter), raw, axis=0), rtol=1e-9
    )


def test_a_filter_of_three_controls_on_two_axes_begins_at_zero(two_axes):
    reference = along(circle(1e-3), 2.5e-5 * np.arange(6), two_axes.dt, 3, at_rest=False)
    machine = LinearPlant(0.5 * np.eye(2), np.ones((2, 3)), np.eye(2), two_axes.dt)
    inside = ContouringLQ(machine, LQWeights(3.0, 5.0, 2e-9), 3)
    memory = Filtered(inside, low_pass(100.0, 0.7, DT), 3).initial_memory(reference)
    np.testing.assert_array_equal(memory.filter, np.zeros((2, 3)))


def test_bad_filters_are_named():
    with pytest.raises(ValueError, match="filter: is not stable"):
        Biquad(placed(np.ones(3)), placed(np.array([0.0, 1.1])))
    with pytest.raises(ValueError, match="not stable"):
        notch(300.0, 0.5, -0.1, DT)
    with pytest.raises(ValueError, match="prewarp"):
        low_pass(1e4, 0.7, DT)
