import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning.objectives import AtMost, worst_contour_error
from tuning.problem import LIMIT_MARGIN, Merit, earned_shares, evaluate_point, smooth_maximum

START = {"x": jnp.asarray(0.5), "y": jnp.asarray(0.8)}
Z = np.log([0.5, 0.8])


def test_smooth_maximum():
    values = jnp.array([1e-6, 3e-6, 2e-6])
    assert float(smooth_maximum(values, jnp.array([0.0, 1.0, 0.0]))) == pytest.approx(3e-6)
    assert float(smooth_maximum(3e-6 * jnp.ones(4), jnp.full(4, 0.25))) == pytest.approx(3e-6)
    assert float(smooth_maximum(jnp.array([5e-6]), jnp.ones(1))) == pytest.approx(5e-6)
    equal = float(smooth_maximum(values, jnp.full(3, 1 / 3)))
    assert 0.9 * 3e-6 < equal <= 3e-6


def test_slopes_of_equal_values_are_their_shares():
    """At the minimax the shares are the multipliers of the values."""
    shares = jnp.array([0.2, 0.5, 0.3])
    np.testing.assert_allclose(
        jax.grad(smooth_maximum)(2e-6 * jnp.ones(3), shares), shares, rtol=1e-12
    )


def test_shares_are_earned_by_large_values_and_never_vanish():
    shares = earned_shares(np.array([1.0, 0.5, 1e-9]), np.full(3, 1 / 3))
    assert shares[0] > 0.99 and shares[2] > 0
    np.testing.assert_allclose(earned_shares(np.ones(2), np.array([0.3, 0.7])), [0.3, 0.7])


def test_lagrangian_is_the_stated_one_and_its_gradient_that_of_differences(proportional_problem):
    problem = proportional_problem(
        AtMost(rms_increment=1e-5, rms_tracking_error=1.0), worst_contour_error
    )
    shares = np.array([0.3, 0.7])
    merit = Merit(np.array([0.2, 0.1, 0.0, 3.0]), np.asarray(4.0), np.asarray(1e-5), shares)
    at = lambda z: evaluate_point(problem, START, jnp.asarray(z), merit)  # noqa: E731
    point = at(Z)
    values, limits = np.asarray(point.objective), np.asarray(point.limits)
    assert limits[0] > 0 > limits[-1]  # one that is violated and one that is not
    pressure = np.maximum(0.0, merit.multipliers + 4.0 * (limits + LIMIT_MARGIN))
    smooth = np.sum(shares * values**16) ** (1 / 16)
    assert float(point.lagrangian) == pytest.approx(
        smooth / 1e-5 + np.sum(pressure**2 - merit.multipliers**2) / 8.0, rel=1e-9
    )
    h = 1e-6
    differences = [
        float(at(Z + h * e).lagrangian - at(Z - h * e).lagrangian) / (2 * h) for e in np.eye(2)
    ]
    np.testing.assert_allclose(point.gradient, differences, rtol=1e-6)
    assert not point.diverged
    assert at(np.log([5.0, 0.8])).diverged  # one plant of the family is enough
    assert at(np.log([1e40, 0.8])).diverged  # not finite
    assert point.metrics.rms_control.shape == (1, 2)
