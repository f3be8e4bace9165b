"""The interior point compiled for the CPU against the readable one, which XLA runs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.qp import interior_point
from jcontour.qp.interior_point import solve

SIZES = {"stages": 6, "states": 4, "controls": 2, "rows": 3}


@pytest.fixture(scope="module")
def problems(staged_problems):
    """Eleven: some give way, one cannot be held, one holds NaN, one is free, one has no limit."""
    qp = staged_problems(5, 11, **SIZES)
    upper = qp.upper.at[:, :, 2:].add(-2.0).at[6].set(1e6).at[7].set(jnp.inf)
    lower = jnp.minimum(qp.lower, upper - 0.1).at[6].set(-1e6).at[7].set(-jnp.inf)
    penalty = qp.penalty.at[:, 2:].set(jnp.array([3.0, 300.0, 30.0])).at[3].set(jnp.inf)
    return qp._replace(lower=lower, upper=upper, penalty=penalty, h=qp.h.at[4, 2, 1].set(jnp.nan))


def converged(monkeypatch, native, qp, guess):
    monkeypatch.setattr(interior_point, "suits_native", lambda *_: native)

    def point(qp, guess):
        return interior_point._converged(qp, interior_point._one_sided(qp), guess)

    found = jax.jit(jax.vmap(point))(qp, guess)
    return jax.tree.map(np.asarray, found)


def test_same_points_after_as_many_iterations(problems, monkeypatch):
    guess = jnp.asarray(np.random.default_rng(0).standard_normal((11, 6, 2)))
    wanted, most = converged(monkeypatch, False, problems, guess)
    found, iterations = converged(monkeypatch, True, problems, guess)
    known = np.arange(11) != 4  # with a NaN in it
    assert iterations[4] == iterations[6] == iterations[7] == 0
    stages = wanted.at.stages[known]
    np.testing.assert_allclose(found.at.stages[known], stages, atol=1e-7 * np.abs(stages).max())
    assert np.abs(iterations - most)[known].max() <= 1  # rounding, where little is left to gain
    solved = known & (most < 20)
    assert solved.sum() >= 8
    for name in "lg":
        one, other = getattr(found, name)[solved], getattr(wanted, name)[solved]
        np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(other).max())


@pytest.mark.slow
def test_one_problem_alone_and_batches_of_batches(problems):
    solved = jax.vmap(solve)(problems)
    nine = jax.tree.map(lambda leaf: leaf[jnp.array([0, 1, 2, 5, 6, 7])], problems)
    nested = jax.tree.map(lambda leaf: leaf.reshape(3, 2, *leaf.shape[1:]), nine)
    together = jax.vmap(jax.vmap(solve))(nested).trajectory.stages.reshape(6, 6, 6)
    apart = solved.trajectory.stages[jnp.array([0, 1, 2, 5, 6, 7])]
    np.testing.assert_allclose(together, apart, atol=1e-13)
    alone = solve(jax.tree.map(lambda leaf: leaf[0], problems))
    np.testing.assert_allclose(alone.trajectory.stages, solved.trajectory.stages[0], atol=1e-13)
    assert not solved.solved[4]


def test_one_model_for_all(problems):
    one = jax.tree.map(lambda leaf: leaf[0], problems)
    shared = jax.vmap(lambda x0: solve(one._replace(x0=x0)).trajectory.stages)(problems.x0[:3])
    for k in range(3):
        alone = solve(one._replace(x0=problems.x0[k])).trajectory.stages
        np.testing.assert_allclose(shared[k], alone, atol=1e-13)
