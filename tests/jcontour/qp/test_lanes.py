"""The interior point with a lane for each problem, interpreted, against the readable one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels.gpu.lanes import Operand
from jcontour.qp import interior_point
from jcontour.qp.interior_point import solve
from jcontour.qp.lanes.interior_point import packed, rows_of
from jcontour.qp.lanes.lane import Problem, Sizes, by_member, in_warps
from jcontour.qp.lanes.sweeps import factorise
from jcontour.qp.staged import factorised

QUICK = {"xla_backend_optimization_level": 0}
SMALLEST = {"stages": 2, "states": 1, "controls": 1, "rows": 1}
SMALL = {"stages": 2, "states": 2, "controls": 1, "rows": 1}
LARGER = {"stages": 4, "states": 3, "controls": 2, "rows": 2}


def problems(staged_problems, sizes):
    """Thirty-five, more than a warp: one holds NaN, one is free, one has no limit.

    A row of the others gives way.
    """
    qp = staged_problems(5, 35, **sizes)
    p = sizes["controls"]
    upper = qp.upper.at[:, :, p:].add(-2.0).at[6].set(1e6).at[7].set(jnp.inf)
    lower = jnp.minimum(qp.lower, upper - 0.1).at[6].set(-1e6).at[7].set(-jnp.inf)
    penalty = qp.penalty.at[:, p:].set(jnp.array([3.0, 300.0][: sizes["rows"]]))
    return qp._replace(lower=lower, upper=upper, penalty=penalty, h=qp.h.at[4, 1, 1].set(jnp.nan))


def answers(monkeypatch, lanes, function, *arguments):
    monkeypatch.setattr(interior_point, "suits_gpu_code", lambda *_: lanes)
    monkeypatch.setattr(interior_point, "suits_native", lambda *_: False)
    # the time goes into compiling, not running
    quick = jax.jit(lambda *all: function(*all), compiler_options=QUICK)
    return jax.tree.map(np.asarray, quick(*arguments))


def agree(found, wanted):
    np.testing.assert_array_equal(found.solved, wanted.solved)
    np.testing.assert_array_equal(found.iterations, wanted.iterations)
    known = wanted.solved
    for name in ("stages", "end"):
        one, other = (getattr(answer.trajectory, name)[known] for answer in (found, wanted))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(other).max())
    for name in ("multipliers", "beyond"):
        one, other = (getattr(answer, name)[known] for answer in (found, wanted))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7 * np.abs(other).max())
    np.testing.assert_array_less(found.residual[known], 1e-6)


def test_factors_are_those_of_the_readable_sweep(staged_problems):
    qp = staged_problems(5, 35, **SMALL)
    (N, v, _), (n, p), r = qp.H.shape[1:], qp.B.shape[1:], qp.D.shape[1]
    W = jnp.asarray(np.random.default_rng(1).exponential(size=(N * r, 35)))
    named = {name: Operand(jnp.moveaxis(leaf, 0, -1), (0,)) for name, leaf in qp._asdict().items()}
    named |= {name: packed(named[name]) for name in ("H", "H_end")}
    sizes, problem = Sizes(N, n, p, r), Problem.of(named)
    work = {name: jnp.zeros(rows * 64) for name, rows in rows_of(sizes).items()}
    right = jnp.moveaxis(qp.h, 0, -1).reshape(N * v, 35)
    known = {"weight": W, "right": right, "slope_end": qp.h_end.T, "open": jnp.ones((1, 35))}
    work |= {name: in_warps(array).reshape(-1) for name, array in known.items()}
    found = jax.jit(lambda work: factorise(sizes, problem, work))(work)
    gram = jnp.einsum("jkb,bkv,bkw->bjvw", W.reshape(N, r, 35), qp.D, qp.D)
    wanted = jax.vmap(factorised)(qp, qp.H + gram, qp.h, qp.h_end)
    upper = [i * p + k for i in range(p) for k in range(i, p)]
    R = wanted.R.reshape(35, N, p * p)[:, :, jnp.array(upper)]
    for name, array in (("Y", wanted.Y), ("y", wanted.y), ("R", R)):
        one = by_member(found[name], rows_of(sizes)[name], 35).T
        np.testing.assert_allclose(one, array.reshape(35, -1), rtol=1e-11, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("sizes", [SMALLEST, LARGER])
def test_answers_are_those_of_the_readable_solver(sizes, staged_problems, monkeypatch):
    qp = problems(staged_problems, sizes)
    guess = jnp.asarray(np.random.default_rng(0).standard_normal((35, *qp.h.shape[1:2], 1)))
    guess = jnp.broadcast_to(guess, (*guess.shape[:2], sizes["controls"]))
    together = jax.vmap(solve)
    found, wanted = (answers(monkeypatch, lanes, together, qp, guess) for lanes in (True, False))
    agree(found, wanted)
    assert not wanted.solved[4] and wanted.solved.sum() > 30
    assert wanted.iterations[6] == wanted.iterations[7] == 0
    assert wanted.beyond.max() > 0.1


@pytest.mark.slow
def test_hard_limits_one_model_and_batches_of_batches(staged_problems, monkeypatch):
    qp = staged_problems(6, 6, **SMALL)
    one = jax.tree.map(lambda leaf: leaf[0], qp)

    def apart(x0, upper):
        return jax.vmap(jax.vmap(lambda x: solve(one._replace(x0=x, upper=upper))))(x0)

    arguments = qp.x0.reshape(3, 2, -1), one.upper
    found, wanted = (answers(monkeypatch, lanes, apart, *arguments) for lanes in (True, False))
    agree(found, wanted)
    assert wanted.solved.all() and wanted.multipliers.max() > 0.1


@pytest.mark.slow
def test_derivatives_are_those_of_the_readable_solver(staged_problems, monkeypatch):
    qp = staged_problems(7, 3, **SMALL)

    def slopes(qp):
        return jax.grad(lambda qp: jnp.sum(jax.vmap(solve)(qp).trajectory.stages ** 2))(qp)

    found, wanted = (answers(monkeypatch, lanes, slopes, qp) for lanes in (True, False))
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7 * max(1.0, np.abs(other).max()))
