"""Sweeps over stages against the same problem as one dense system of equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.qp import staged
from jcontour.qp.staged import Trajectory
from tests.jcontour.qp.problems import condensed, one_of, staged_problems

resolved_step, costates, free_response, backward_sweep, rollout, gradient, forward_sweep = map(
    jax.jit,
    (
        staged.resolved_step,
        staged.costates,
        staged.free_response,
        staged.backward_sweep,
        staged.rollout,
        staged.gradient,
        staged.forward_sweep,
    ),
)


def close(actual, wanted, tolerance=1e-10):
    scale = max(float(np.abs(wanted).max()), 1.0)
    np.testing.assert_allclose(actual, wanted, rtol=0, atol=tolerance * scale)


@pytest.fixture(scope="module")
def qp():
    return one_of(staged_problems(0, 1, stages=5, states=3, controls=2), 0)


@pytest.fixture(scope="module")
def controls():
    return np.random.default_rng(1).standard_normal((5, 2))


def cost(qp, at: Trajectory):
    inner = jnp.einsum("ja,jab,jb->", at.stages, qp.H, at.stages) + at.end @ qp.H_end @ at.end
    return 0.5 * inner + jnp.sum(qp.h * at.stages) + qp.h_end @ at.end


def test_the_states_are_those_of_a_loop(qp, controls):
    x, states = np.asarray(qp.x0), []
    for u, c in zip(np.asarray(controls), np.asarray(qp.c), strict=True):
        states.append(x)
        x = np.asarray(qp.A) @ x + np.asarray(qp.B) @ u + c
    at = rollout(qp, controls)
    close(at.stages, np.concatenate([states, controls], axis=1))
    close(at.end, x)
    without, end = free_response(qp, qp.x0, qp.c + controls @ qp.B.T)
    close(without, np.array(states))
    close(end, x)


def test_a_step_is_the_dense_minimum_and_another_slope_needs_no_other_factors(qp):
    dense, F, G = condensed(qp)
    z = -np.linalg.solve(dense.H, dense.g)
    start = rollout(qp, np.zeros((5, 2)))
    actual = backward_sweep(qp, qp.H, *gradient(qp, start))
    step = forward_sweep(qp, actual)
    close(start.stages + step.stages, F + G @ z)
    again = resolved_step(qp, actual, *(2 * np.asarray(slope) for slope in gradient(qp, start)))
    close(again.stages, 2 * np.asarray(step.stages))
    close(again.end, 2 * np.asarray(step.end))


def test_slopes_are_those_of_the_cost(qp, controls):
    at = rollout(qp, controls)
    for actual, wanted in zip(gradient(qp, at), jax.jit(jax.grad(cost, 1))(qp, at), strict=True):
        close(actual, wanted)


def test_costates_are_the_slopes_of_the_cost_with_what_is_added_to_a_state(qp, controls):
    """A step c_j more moves the cost by the multiplier of x_{j+1}."""

    def moved(c):
        return cost(qp, rollout(qp._replace(c=c), controls))

    close(costates(qp, gradient(qp, rollout(qp, controls))), jax.jit(jax.grad(moved))(qp.c))


def test_no_curvature_is_not_hidden(qp):
    """A cost that falls without end has no factors: NaN, not a number."""
    falling = qp._replace(H=-qp.H, H_end=-qp.H_end)
    assert np.isnan(backward_sweep(falling, falling.H, falling.h, falling.h_end).R).any()


def case(seed=0, count=12):
    random = np.random.default_rng(seed)
    upper, lower = random.uniform(0.5, 2.0, count), -random.uniform(0.5, 2.0, count)
    upper[3], lower[5] = np.inf, -np.inf
    penalty = np.where(np.arange(count) % 2 == 0, 4.0, np.inf)
    rows, moved = (random.standard_normal(count) for _ in range(2))
    return *jax.device_get(start(upper, lower, penalty, rows)), rows, moved


@jax.jit
def start(upper, lower, penalty, rows):
    limits = staged.sides(upper, lower, penalty)[0]
    return limits, staged.first_point((), limits.bound - rows, jnp.asarray(0.3), limits, 0.5)


@jax.jit
def whole_step(limits, point, rows, moved, aim):
    """Changes, the point behind them, and by how much it misses its limits."""
    here = staged.newton(point, limits, rows)
    c1, c2 = (product - aim for product in staged.predictor_products(point, limits))
    pushed = staged.constant_term(here, point, limits, c1, c2)
    steps = staged.direction(here, point, limits, moved + pushed, c1, c2)
    after = staged.advanced(point, (), steps, 1.0)
    return steps, after, staged.primal_residual(after, limits, rows + moved)


@jax.jit
def possible_step(limits, point, rows, moved):
    """The possible part of a step, the point behind it, and one that is beyond it."""
    here = staged.newton(point, limits, rows)
    aims = staged.predictor_products(point, limits)
    steps = staged.direction(here, point, limits, moved, *aims)
    far = staged.step_length(point, steps, limits)
    return far, *(staged.advanced(point, (), steps, much * far) for much in (1.0, 1.01))


@pytest.mark.parametrize("aim", [0.0, 0.2])
def test_a_step_puts_the_four_equations_right(aim):
    limits, point, rows, moved = case()
    steps, after, left = jax.device_get(whole_step(limits, point, rows, moved, aim))
    there, gives = limits.finite, limits.soft
    assert there.sum() == 11 and gives.sum() == 6
    np.testing.assert_allclose(left, 0.0, atol=1e-13)
    np.testing.assert_allclose((after.l + after.g)[gives], limits.price[gives], rtol=1e-13)
    linear = point.s * steps.l + point.l * steps.s + point.s * point.l
    np.testing.assert_allclose(linear[there], aim, atol=1e-13)
    linear = point.t * steps.g + point.g * steps.t + point.t * point.g
    np.testing.assert_allclose(linear[gives], aim, atol=1e-13)


def test_the_first_products_are_mu_where_the_price_allows_it():
    limits, point, _, _ = case()
    held = limits.finite & ~limits.soft
    np.testing.assert_allclose((point.s * point.l)[held], 0.3, rtol=1e-13)
    np.testing.assert_allclose((point.t * point.g)[limits.soft], 0.3, rtol=1e-13)
    assert float(point.l[3]) == 0.0 and (point.l < limits.price)[limits.soft].all()


def test_the_possible_part_of_a_step_ends_at_the_nearest_zero():
    limits, point, rows, moved = case(1)
    step = possible_step(limits, point, rows, 50.0 * moved)
    far, reached, beyond = jax.device_get(step)
    assert far.min() < 1.0 and far.max() <= 1.0
    for part in reached[1:]:
        assert part.min() >= -1e-12
    nearest = np.min(beyond[1:], axis=0)
    assert (nearest[far < 1.0] < 0).all()


def test_widths():
    upper, lower = np.array([3.0, np.inf, 2.0, 0.0]), np.array([-1.0, -4.0, 2.0, -np.inf])
    above, below = jax.jit(staged.sides)(upper, lower, np.full(4, np.inf))
    np.testing.assert_array_equal(above.width, [2.0, 4.0, 2.0, 1.0])
    np.testing.assert_array_equal(below.finite, [True, True, True, False])
    np.testing.assert_array_equal(below.bound, [1.0, 4.0, -2.0, 0.0])
