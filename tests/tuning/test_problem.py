import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning.objectives import AtMost, Entry, typical_contour_error, worst_contour_error
from tuning.problem import (
    LIMIT_MARGIN,
    Merit,
    earned_shares,
    evaluate_point,
    objective_value,
    smooth_maximum,
)

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


def test_rows_count_by_their_geometric_mean():
    values = np.array([[1e-6, 4e-6], [9e-6, 2e-6]])
    assert objective_value(values) == pytest.approx(6e-6, rel=1e-12)
    own = np.array([[0.0, 1.0], [1.0, 0.0]])
    np.testing.assert_allclose(smooth_maximum(values, own), [4e-6, 9e-6], rtol=1e-12)
    shares = earned_shares(values, np.full((2, 2), 0.5))
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=2e-6)  # every row shares by itself
    assert shares[0, 1] > 0.99 and shares[1, 0] > 0.99


def test_lagrangian_is_the_stated_one_and_its_gradient_that_of_differences(proportional_problem):
    problem = proportional_problem(
        AtMost(rms_increment=1e-5, rms_tracking_error=1.0), worst_contour_error
    )
    shares = np.array([[0.3, 0.7]])
    merit = Merit(np.array([0.2, 0.1, 0.0, 3.0]), np.asarray(4.0), np.asarray(1e-5), shares)
    at = lambda z: evaluate_point(problem, START, jnp.asarray(z), merit)  # noqa: E731
    point = at(Z)
    (values,), limits = np.asarray(point.objective), np.asarray(point.limits)
    assert limits[0] > 0 > limits[-1]  # one that is violated and one that is not
    pressure = np.maximum(0.0, merit.multipliers + 4.0 * (limits + LIMIT_MARGIN))
    smooth = np.sum(shares[0] * values**16) ** (1 / 16)
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
    assert point.outcome.metrics.rms_control.shape == (1, 2)


@pytest.mark.parametrize("typical", [False, True])
def test_gradient_of_limited_loops_is_that_of_differences(
    proportional_problem, loop_peaks, typical
):
    problem = proportional_problem(
        AtMost(peak_sensitivity=1.2, rms_increment=1e-5),
        typical_contour_error if typical else worst_contour_error,
        loops=loop_peaks,
    )
    assert problem.counts(START) == (6, (1, 2))
    shares = np.array([[0.3, 0.7]])
    merit = Merit(np.array([0.2, 0.1, 0.3, 0, 0, 1]), np.asarray(4.0), np.asarray(1e-5), shares)
    at = lambda z: evaluate_point(problem, START, jnp.asarray(z), merit)  # noqa: E731
    point, h = at(Z), 1e-6
    gains = np.array([0.5 * 1.0, 0.8 * 0.7]), np.array([0.5 * 0.9, 0.8 * 0.8])
    worst = [max(2 / (2 - gain)) for gain in gains]
    np.testing.assert_allclose(point.limits[:4], 2 * [*np.log(np.array(worst) / 1.2)])
    np.testing.assert_allclose(point.outcome.loops.sensitivity, 2 * [worst])
    differences = [
        float(at(Z + h * e).lagrangian - at(Z - h * e).lagrangian) / (2 * h) for e in np.eye(2)
    ]
    np.testing.assert_allclose(point.gradient, differences, rtol=1e-6)


def test_an_unstable_loop_is_divergence(proportional_problem, loop_peaks):
    """Gains just above 2 do not leave the circle within its 20 samples."""
    merit = Merit(np.zeros(0), np.asarray(4.0), np.asarray(1e-5), np.array([[0.5, 0.5]]))
    z = jnp.log(jnp.array([2.01, 0.8]))
    without = proportional_problem(objective=worst_contour_error)
    assert not evaluate_point(without, START, z, merit).diverged
    looked = proportional_problem(objective=worst_contour_error, loops=loop_peaks)
    point = evaluate_point(looked, START, z, merit)
    assert point.diverged and float(point.outcome.loops.spectral_radius.max()) > 1


def test_entries_of_limits(proportional_problem, loop_peaks):
    problem = proportional_problem(AtMost(peak_sensitivity=2.0), loops=loop_peaks)
    outcome = problem.outcome(START)
    assert problem.limit_entries(outcome)[3] == Entry("peak_sensitivity", 1, 1)
    own = proportional_problem(lambda outcome: outcome.metrics.rms_control[0] - 1.0)
    assert own.limit_entries(outcome) == [Entry("limit", 0, 0), Entry("limit", 1, 0)]


@pytest.mark.parametrize("values", [jnp.ones(3), jnp.ones((0, 3)), jnp.ones((1, 2, 3))])
def test_values_without_rows_are_refused(proportional_problem, values):
    with pytest.raises(ValueError, match="objective: needs rows of values"):
        proportional_problem(objective=lambda metrics: values).counts(START)


def test_loops_that_are_not_looked_at_cannot_be_limited(proportional_problem):
    problem = proportional_problem(AtMost(peak_sensitivity=2.0))
    with pytest.raises(ValueError, match="peak_sensitivity: .* windows"):
        problem.counts(START)
    with pytest.raises(ValueError, match="does not look at its frozen loops"):
        problem.loop_peaks(START)
