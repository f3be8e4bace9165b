"""The interior point with a lane for each problem, interpreted, against the readable one."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels import arithmetic
from jcontour.kernels.gpu.lanes import Operand
from jcontour.qp import interior_point
from jcontour.qp.interior_point import solve
from jcontour.qp.lanes import lane
from jcontour.qp.lanes.check import check
from jcontour.qp.lanes.found import rows_of
from jcontour.qp.lanes.iteration import ITERATION
from jcontour.qp.lanes.kernel import Sizes
from jcontour.qp.lanes.lane import Layout, Problem, by_member, in_warps, kept_beside, run
from jcontour.qp.lanes.on_gpu import packed
from jcontour.qp.lanes.start import START
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
    qp = jax.tree.map(jnp.asarray, staged_problems(5, 35, **sizes))
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


def in_lanes(qp):
    """Sizes, the problems as the lanes have them, and arrays for 64 lanes."""
    (N, _), (n, p), r = qp.h.shape[1:], qp.B.shape[1:], qp.D.shape[1]
    named = {name: Operand(jnp.moveaxis(leaf, 0, -1), (0,)) for name, leaf in qp._asdict().items()}
    named |= {name: packed(named[name]) for name in ("H", "H_end")}
    sizes = Sizes(N, n, p, r)
    work = {name: jnp.zeros(rows * 64, qp.h.dtype) for name, rows in rows_of(sizes).items()}
    return sizes, Problem.of(named), work


@pytest.mark.slow
def test_factors_are_those_of_the_readable_sweep(staged_problems):
    qp = staged_problems(5, 35, **SMALL)
    sizes, problem, work = in_lanes(qp)
    N, n, p, r = sizes
    v = sizes.v
    W = np.random.default_rng(1).exponential(size=(N * r, 35))
    right = np.moveaxis(qp.h, 0, -1).reshape(N * v, 35)
    known = {"weight": W, "right": right, "slope_end": qp.h_end.T, "open": np.ones((1, 35))}
    work |= {name: in_warps(array).reshape(-1) for name, array in known.items()}
    found = jax.jit(lambda work: run(factorise, sizes, problem, work))(work)
    gram = np.einsum("jkb,bkv,bkw->bjvw", W.reshape(N, r, 35), qp.D, qp.D)
    wanted = jax.vmap(factorised)(qp, qp.H + gram, qp.h, qp.h_end)
    upper = [i * p + k for i in range(p) for k in range(i, p)]
    R = wanted.R.reshape(35, N, p * p)[:, :, jnp.array(upper)]
    for name, array in (("Y", wanted.Y), ("y", wanted.y), ("R", R)):
        one = by_member(found[name], rows_of(sizes)[name], 35).T
        np.testing.assert_allclose(one, array.reshape(35, -1), rtol=1e-11, atol=1e-12)


def test_what_finds_room_is_kept_beside_the_processor():
    rows = {"A": 121, "B": 22, "H": 1820, "H_end": 66, "D": 65}  # 11 states, 2 controls, 5 rows

    def kept(size, **axes):
        layouts = [Layout(count, axes.get(name, (0,))) for name, count in rows.items()]
        return dict(kept_beside(factorise, layouts, (0,), size))

    assert kept(8) == {"A": 121, "B": 22}  # 36,608 of 49,152 bytes, and D has 16,640
    assert kept(4) == {"A": 121, "B": 22, "D": 65}
    assert kept(8, A=()) == {"B": 22, "D": 65}  # one model for all


@pytest.fixture
def for_a_gpu(monkeypatch):
    """Kernels are written for a GPU, which no test needs, and none of them is kept."""
    monkeypatch.setattr(lane, "_built", lane._built.__wrapped__)
    for module in (lane, arithmetic):
        monkeypatch.setattr(module, "on_gpu", lambda: True)
    monkeypatch.setattr(interior_point, "suits_gpu_code", lambda *_: True)


def typed(qp, dtype):
    return jax.tree.map(lambda leaf: leaf.astype(dtype), qp)


def text_of(function, *arguments):
    """Jaxpr with the code of its kernels."""
    return str(jax.make_jaxpr(function)(*arguments))


def test_check_is_written_for_a_gpu_in_single_precision(staged_problems, for_a_gpu):
    qp = typed(staged_problems(5, 35, **SMALLEST), "float32")
    text = text_of(lambda qp: run(check, *in_lanes(qp)), qp)
    assert "fma.rn.f32" in text and ".f64" not in text


@pytest.mark.slow
@pytest.mark.parametrize(("dtype", "other"), [("float32", "f64"), ("float64", "f32")])
def test_every_kernel_is_written_for_a_gpu(dtype, other, staged_problems, for_a_gpu):
    text = text_of(jax.vmap(solve), typed(staged_problems(5, 35, **SMALL), dtype))
    assert text.count("ffi_call") == len((*START, *ITERATION, check))
    assert not re.search(rf"\b(ld|st|add|sub|mul|fma|div|sqrt)[.\w]*\.{other}", text)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(0,), (2, 0)])
def test_an_empty_batch_has_an_empty_answer(shape, staged_problems, monkeypatch):
    one = jax.tree.map(lambda leaf: leaf[0], staged_problems(5, 1, **SMALLEST))

    def trajectory(x0):
        together = solve
        for _ in shape:
            together = jax.vmap(together)
        qp = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (*shape, *leaf.shape)), one)
        return together(qp._replace(x0=x0)).trajectory.stages

    monkeypatch.setattr(interior_point, "suits_gpu_code", lambda *_: True)
    x0 = np.zeros((*shape, 1))
    slope = jax.eval_shape(jax.grad(lambda x0: jnp.sum(trajectory(x0))), x0)
    assert jax.eval_shape(trajectory, x0).shape == (*shape, 2, 2) and slope.shape == x0.shape


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
