"""Speed axes against SciPy's discretisation and against the speeds that they settle at."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from jcontour.controllers.synchronisation.speed_axes import speed_axes


@pytest.mark.parametrize("dt", [2e-3, 1e-2, 1.0])
def test_sampled_as_scipy_does(dt):
    axes = speed_axes([10.0, 3.0], [50.0, 20.0])
    a_d, b_d = axes.sampled(dt)
    for axis in range(2):
        matrices = ([[-axes.pole[axis]]], [[axes.gain[axis]]], [[1.0]], [[0.0]])
        A, B, *_ = cont2discrete(tuple(np.array(matrix) for matrix in matrices), dt)
        np.testing.assert_allclose([a_d[axis], b_d[axis]], [A.item(), B.item()], rtol=1e-12)


def test_feedforward_reproduces_any_speed():
    """One sample with the ideal estimates lands on the next speed."""
    axes, dt = speed_axes([10.0, 3.0], [50.0, 20.0]), 5e-3
    a_d, b_d = axes.sampled(dt)
    now, later = np.array([0.3, -0.2]), np.array([0.5, 0.1])
    signals = np.stack([now, later, np.ones(2)], axis=-1)
    control = np.sum(axes.feedforward(dt) * signals, axis=-1)
    np.testing.assert_allclose(a_d * now + b_d * control, later, atol=1e-15)
    slope = np.array([2.0, -1.0])
    signals = np.stack([now, slope, np.ones(2)], axis=-1)
    control = np.sum(axes.feedforward() * signals, axis=-1)
    np.testing.assert_allclose(-axes.pole * now + axes.gain * control, slope, atol=1e-14)


@pytest.mark.parametrize(("pole", "gain"), [(0.0, 1.0), (1.0, [1.0, -2.0]), (np.inf, 1.0)])
def test_bad_numbers(pole, gain):
    with pytest.raises(ValueError, match="needs to be above zero"):
        speed_axes(pole, gain)
