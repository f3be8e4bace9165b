"""Sweeps over stages against the same problem as one dense system of equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.qp import staged
from jcontour.qp.staged import Trajectory

another_step, costates, drifted, factorised, rollout, slopes, step_of = map(
    jax.jit,
    (
        staged.another_step,
        staged.costates,
        staged.drifted,
        staged.factorised,
        staged.rollout,
        staged.slopes,
        staged.step_of,
    ),
)


def close(actual, wanted, tolerance=1e-10):
    scale = max(float(np.abs(wanted).max()), 1.0)
    np.testing.assert_allclose(actual, wanted, rtol=0, atol=tolerance * scale)


@pytest.fixture(scope="module")
def qp(staged_problems, one_of):
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
    without, end = drifted(qp, qp.x0, qp.c + controls @ qp.B.T)
    close(without, np.array(states))
    close(end, x)


def test_a_step_is_the_dense_minimum_and_another_slope_needs_no_other_factors(qp, condensed):
    dense, F, G = condensed(qp)
    z = -np.linalg.solve(dense.H, dense.g)
    start = rollout(qp, np.zeros((5, 2)))
    actual = factorised(qp, qp.H, *slopes(qp, start))
    step = step_of(qp, actual)
    close(start.stages + step.stages, F + G @ z)
    again = another_step(qp, actual, *(2 * np.asarray(slope) for slope in slopes(qp, start)))
    close(again.stages, 2 * np.asarray(step.stages))
    close(again.end, 2 * np.asarray(step.end))


def test_slopes_are_those_of_the_cost(qp, controls):
    at = rollout(qp, controls)
    for actual, wanted in zip(slopes(qp, at), jax.jit(jax.grad(cost, 1))(qp, at), strict=True):
        close(actual, wanted)


def test_costates_are_the_slopes_of_the_cost_with_what_is_added_to_a_state(qp, controls):
    """A step c_j more moves the cost by the multiplier of x_{j+1}."""

    def moved(c):
        return cost(qp, rollout(qp._replace(c=c), controls))

    close(costates(qp, slopes(qp, rollout(qp, controls))), jax.jit(jax.grad(moved))(qp.c))


def test_no_curvature_is_not_hidden(qp):
    """A cost that falls without end has no factors: NaN, not a number."""
    falling = qp._replace(H=-qp.H, H_end=-qp.H_end)
    assert np.isnan(factorised(falling, falling.H, falling.h, falling.h_end).R).any()
