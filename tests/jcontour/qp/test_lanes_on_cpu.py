"""The interior point written out for this processor against the readable one."""

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
    return _of_all_kinds(staged_problems(5, 11, **SIZES))


@jax.jit
def _of_all_kinds(qp):
    upper = qp.upper.at[:, :, 2:].add(-2.0).at[6].set(1e6).at[7].set(jnp.inf)
    lower = jnp.minimum(qp.lower, upper - 0.1).at[6].set(-1e6).at[7].set(-jnp.inf)
    penalty = qp.penalty.at[:, 2:].set(jnp.array([3.0, 300.0, 30.0])).at[3].set(jnp.inf)
    return qp._replace(lower=lower, upper=upper, penalty=penalty, h=qp.h.at[4, 2, 1].set(jnp.nan))


def answers(monkeypatch, native, qp, guess):
    monkeypatch.setattr(interior_point, "suits_native", lambda *_: native)
    found = jax.jit(jax.vmap(solve))(qp, guess)
    return jax.tree.map(np.asarray, found)


@pytest.mark.slow
def test_answers_are_those_of_the_readable_solver(problems, monkeypatch):
    guess = np.random.default_rng(0).standard_normal((11, 6, 2))
    wanted, found = (answers(monkeypatch, native, problems, guess) for native in (False, True))
    np.testing.assert_array_equal(found.solved, wanted.solved)
    assert wanted.solved.sum() >= 9 and not wanted.solved[4]
    assert found.iterations[4] == found.iterations[6] == found.iterations[7] == 0
    difference = np.abs(found.iterations - wanted.iterations)[wanted.solved]
    assert difference.max() <= 1  # rounding, where little is left to gain
    for one, other in zip(found.trajectory, wanted.trajectory, strict=True):
        one, other = one[wanted.solved], other[wanted.solved]
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-8 * np.abs(other).max())
    for name in ("multipliers", "beyond"):
        one, other = (getattr(answer, name)[wanted.solved] for answer in (found, wanted))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7 * np.abs(other).max())
    assert found.residual[wanted.solved].max() < 1e-6 and wanted.beyond.max() > 0.1


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


@pytest.mark.slow
def test_one_model_for_all(problems):
    one = jax.tree.map(lambda leaf: leaf[0], problems)
    shared = jax.vmap(lambda x0: solve(one._replace(x0=x0)).trajectory.stages)(problems.x0[:3])
    for k in range(3):
        alone = solve(one._replace(x0=problems.x0[k])).trajectory.stages
        np.testing.assert_allclose(shared[k], alone, atol=1e-13)


def test_a_problem_without_states_is_not_written_out(staged_problems):
    """Its members could not be counted by them: the answer would be whatever memory holds."""
    qp = jax.tree.map(lambda leaf: leaf[0], staged_problems(5, 1, **SIZES))
    assert interior_point._written_out(qp) is not None
    none = qp._replace(A=qp.A[:0, :0], B=qp.B[:0], x0=qp.x0[:0], D=qp.D[:, 4:])
    assert interior_point._written_out(none) is None
