"""Metrics of an LQ contouring run by the kernels of `lq_kernels`, as a function of JAX.

It works under `jit`, `vmap` (any depth) and `shard_map`, and has first derivatives in both modes.
Slopes with alpha, beta and rho come from the kernel; with anything else from the readable form.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import warp as wp
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jcontour.kernels.lq_kernels import LANES, LEAST, LONGEST_WINDOW, ROWS, kernels
from jcontour.linear.plant import LinearPlant, decoupled_axes, operating_point
from jcontour.motion.references import Reference
from jcontour.riccati.decoupled import ContouringProblem, axis_windows
from jcontour.simulation.closed_loop import start_state
from jcontour.simulation.metrics import Metrics, scored_samples
from jcontour.tracing import is_concrete

wp.config.quiet = True  # pyright: ignore[reportAttributeAccessIssue]
REAL = {"float32": wp.float32, "float64": wp.float64}
BLOCK = 64  # threads; a kernel is compiled anew for every other number
MOST_STATES = 16  # of an axis: loops over more are not unrolled


def suits(problem: ContouringProblem, plant: LinearPlant, reference: Reference) -> bool:
    """Whether the kernels take a run: lines and arcs, a short window, axes that nothing couples."""
    axes = decoupled_axes(plant.pattern)
    types = {str(leaf.dtype) for leaf in (problem.y_d, plant.A, problem.model.A, problem.alpha)}
    return (
        problem.preview <= LONGEST_WINDOW
        and axes == decoupled_axes(problem.model.pattern)
        and max(len(axis.states) for axis in axes) <= MOST_STATES
        and not reference.contour.newton_steps
        and len(types) == 1
        and types <= REAL.keys()
    )


def metrics(
    problem: ContouringProblem,
    plant: LinearPlant,
    reference: Reference,
    window: tuple[int, int] | None,
    readable: Callable[[ContouringProblem, LinearPlant, Reference], Metrics],
) -> Metrics:
    """Metrics of a run of `plant` under the receding-horizon law of `problem`.

    Args:
        problem: its weights are those of the run.
        plant: the machine, with the axes of the model.
        reference: of the run.
        window: samples a..b-1 that are scored; all when not given.
        readable: the same metrics in plain JAX, for slopes with other numbers than the weights.
    """
    weights = _weights_of(problem)
    kept = eqx.tree_at(_weights_of, problem, (None, None, None))
    others, tree = jax.tree.flatten((kept, plant, reference))

    def rebuilt(weights, others) -> tuple[ContouringProblem, LinearPlant, Reference]:
        problem, *rest = jax.tree.unflatten(tree, others)
        return eqx.tree_at(_weights_of, problem, weights, is_leaf=_is_none), *rest

    @jax.custom_jvp
    def of(weights, others) -> Metrics:
        run = rebuilt(weights, others)
        (out,) = _launched(*run, window, False)
        return _finished(out, run[2], window)[0]

    @partial(of.defjvp, symbolic_zeros=True)
    def _(primals, tangents):
        if not all(isinstance(leaf, SymbolicZero) for leaf in tangents[1]):
            dense = jax.tree.map(_dense, primals, tangents, is_leaf=_is_leaf)
            return jax.jvp(lambda *some: readable(*rebuilt(*some)), primals, dense)
        run = rebuilt(*primals)
        out, slope = _launched(*run, window, True)
        value, half = _finished(out, run[2], window)
        alpha, beta, rho = primals[0]
        d_alpha, d_beta, d_rho = map(_dense, primals[0], tangents[0])
        q = alpha + beta
        of_kappa = (d_alpha + d_beta) / q - d_rho / rho
        of_share = (d_beta * alpha - d_alpha * beta) / q**2
        change = (slope[0] * of_kappa + slope[1] * of_share) * half
        numbers = [change[place] for row in range(ROWS) for place in (row, ROWS + row)]
        still = jnp.zeros_like(value.duration), np.zeros((), jax.dtypes.float0)
        return value, Metrics(*numbers, *still)

    return of(weights, others)


def _weights_of(problem: ContouringProblem) -> tuple:
    return problem.alpha, problem.beta, problem.rho


def _is_none(leaf: Any) -> bool:
    return leaf is None


def _is_leaf(leaf: Any) -> bool:
    return isinstance(leaf, SymbolicZero)


def _dense(like, tangent):
    """A tangent as an array."""
    if not isinstance(tangent, SymbolicZero):
        return tangent
    if jnp.issubdtype(jnp.result_type(like), jnp.floating):
        return jnp.zeros_like(like)
    return np.zeros(jnp.shape(like), jax.dtypes.float0)


def _finished(
    out: Float[Array, " rows"], reference: Reference, window: tuple[int, int] | None
) -> tuple[Metrics, Float[Array, " rows"]]:
    """Metrics from sums and peaks of squares, and their slopes with half of these."""
    mask = scored_samples(reference, window)
    count = jnp.maximum(jnp.sum(mask), 1).astype(out.dtype)
    pairs = jnp.maximum(jnp.sum(mask[1:] & mask[:-1]), 1).astype(out.dtype)
    means = jnp.stack([count] * (ROWS - 1) + [pairs] + [jnp.ones_like(count)] * ROWS)
    root = jnp.sqrt(out[:-1] / means)
    half = jnp.where(root > 0, 1 / (means * jnp.where(root > 0, root, 1)), 0)
    numbers = [root[place] for row in range(ROWS) for place in (row, ROWS + row)]
    duration = jnp.sum(mask).astype(out.dtype) * reference.dt
    return Metrics(*numbers, duration=duration, diverged=out[-1] != 0), half


def _launched(
    problem: ContouringProblem, plant: LinearPlant, reference: Reference, window, with_slopes: bool
) -> tuple[Array, ...]:
    """Sums, peaks and divergence of one run, and slopes; a `vmap` of it is one launch."""
    N, dtype, double = problem.preview, plant.A.dtype, jnp.result_type(float)
    axes = decoupled_axes(plant.pattern)
    n, steps = max(len(axis.states) for axis in axes), reference.steps
    windows = axis_windows(problem.model, N)
    q = problem.alpha + problem.beta
    own = [q / problem.rho, jnp.maximum(problem.beta / q, LEAST)]
    own += [] if problem.stage is None else list(problem.stage)
    own = jnp.stack(own).astype(double)[:, None]
    state = start_state(plant, reference)
    padded = partial(_padded, [axis.states for axis in axes], n)
    A = jnp.stack(
        [
            jnp.pad(plant.A[np.ix_(axis.states, axis.states)], (0, n - len(axis.states)))
            for axis in axes
        ]
    )
    B = jnp.stack([padded(a, plant.B[:, axis.inputs[0]]) for a, axis in enumerate(axes)])
    C = jnp.stack([padded(a, plant.C[axis.outputs[0]]) for a, axis in enumerate(axes)])
    ahead = jnp.stack([jnp.pad(one.O, ((0, 0), (0, n - one.O.shape[1]))) for one in windows])
    at = operating_point(problem.model, reference.position[0])
    inputs = np.array([axis.inputs[0] for axis in axes])
    held = [one.O @ at.state[np.array(a.states)] for one, a in zip(windows, axes, strict=True)]
    rest = jnp.stack(held) - at.position[:, None]
    contour = reference.contour
    pieces = [contour.polynomial[:, 0], contour.polynomial[:, 1], contour.cosine, contour.sine]
    pieces += [row[:, None] for row in (contour.rate, contour.start, contour.extent)]
    whole = contour.length, contour.size, contour.closed, jnp.sum(contour.mask)
    shared = [
        A.ravel(), B.ravel(), C.ravel(), ahead.ravel(), jnp.zeros(steps + 2, "int32"),
        problem.tangent.T.ravel(), problem.y_d.T.ravel(), rest.ravel(),
        at.control[inputs], reference.arc[:steps],
        scored_samples(reference, window).astype("int32"),
        jnp.stack([padded(a, state) for a in range(len(axes))]),
        jnp.concatenate(pieces, axis=1),
        jnp.stack([jnp.asarray(number, dtype) for number in whole]),
    ]  # fmt: skip
    shared = [one if one.dtype == "int32" else one.astype(dtype) for one in shared]
    call = _caller((len(axes), n, N), str(dtype), with_slopes, problem.stage is not None)
    G = jnp.stack([one.G for one in windows]).astype(double)
    return tuple(one[..., 0] for one in call(own, *_responses(G, problem.stage), *shared))


def _padded(states, n: int, a: int, row):
    """Entries of an axis's states, with zeros up to n."""
    own = row[np.array(states[a])]
    return jnp.pad(own, [(0, n - len(own)), *[(0, 0)] * (own.ndim - 1)])


def _responses(G: Float[Array, "m N N"], stage) -> tuple[Array, ...]:
    """The forced responses; without a profile by their singular values, once a machine."""
    if stage is not None:
        return (G,)
    if is_concrete(G):
        U, sigma, V = np.linalg.svd(np.asarray(G))
    else:
        U, sigma, V = jnp.linalg.svd(G)
    return jnp.asarray(U), jnp.asarray(sigma**2), jnp.asarray(sigma * V[:, :, 0])


def _designed(own: Float[Array, "rows runs"], responses, dtype, with_slopes: bool) -> list[Array]:
    """Numbers that each run's kernel reads for itself: f, triangles of f M, kappa M h, profile.

    With slopes M is followed by M M - M, and kappa M h by kappa M M h.
    """
    kappa, forgiven, *stage = own
    i, j = np.tril_indices(responses[0].shape[1])
    if stage:
        (G,), scale = responses, jnp.sqrt(own[2:])
        G = jnp.moveaxis(scale, 1, 0)[:, None, :, None] * G[None]
        identity = jnp.eye(G.shape[-1])[None, None]
        whole = jnp.linalg.inv(identity + kappa[:, None, None, None] * G @ G.mT)
        column = kappa[:, None, None] * jnp.einsum("baij,baj->bai", whole, G[..., 0])
        if with_slopes:
            column = jnp.concatenate([column, jnp.einsum("baij,baj->bai", whole, column)], axis=1)
            whole = jnp.concatenate([whole, whole @ whole - whole], axis=1)
        M, Mh = jnp.moveaxis(whole[:, :, i, j], 0, -1), jnp.moveaxis(column, 0, -1)
    else:
        U, square, h = responses
        scale = jnp.zeros((0, 0))
        values = 1 / (1 + kappa[None, None] * square[..., None])
        column = h[..., None] / (1 / kappa[None, None] + square[..., None])
        if with_slopes:
            U = jnp.concatenate([U, U])
            column = jnp.concatenate([column, values * column])
            values = jnp.concatenate([values, values * (values - 1)])
        M = jnp.einsum("apq,aqb->apb", U[:, i] * U[:, j], values)
        Mh = jnp.einsum("aiq,aqb->aib", U, column)
    rows = forgiven[None], _tiled(forgiven[None, None] * M), _tiled(Mh), scale
    return [one.astype(dtype) for one in rows]


def _tiled(rows: Float[Array, "*rows runs"]) -> Float[Array, " numbers"]:
    """Numbers of `LANES` runs side by side, one row after the other."""
    rows = rows.reshape(-1, rows.shape[-1])
    rows = jnp.pad(rows, ((0, 0), (0, -rows.shape[1] % LANES)))
    return rows.reshape(len(rows), -1, LANES).swapaxes(0, 1).ravel()


@lru_cache
def _caller(size: tuple[int, int, int], dtype: str, with_slopes: bool, profiled: bool):
    """Function of a run's weights (rows, runs) and the shared arrays; see `kernels`."""
    kernel = kernels(*size, REAL[dtype], profiled)[with_slopes]
    launch = wp.jax_kernel(kernel, num_outputs=1 + with_slopes, block_dim=BLOCK)
    parts = 1 if profiled else 3

    @custom_vmap
    def call(own, *shared):
        runs = own.shape[1]
        shapes = {"out": (2 * ROWS + 1, runs)}
        shapes |= {"slope": (2, 2 * ROWS, runs)} if with_slopes else {}
        rows = _designed(own, shared[:parts], dtype, with_slopes)
        return tuple(launch(*rows, *shared[parts:], launch_dims=runs, output_dims=shapes))

    @call.def_vmap
    def more(size, batched, *given):
        every = (True,) * (1 + with_slopes)
        if any(batched[1:]):  # other machines or references: one launch after the other
            moving = [one for one, moves in zip(given, batched, strict=True) if moves]

            def one(moving):
                rest = iter(moving)
                return call(*(next(rest) if b else a for a, b in zip(given, batched, strict=True)))

            return jax.lax.map(one, moving), every
        own, *shared = given
        rows, runs = own.shape[1:]
        found = call(jnp.moveaxis(own, 0, 1).reshape(rows, size * runs), *shared)
        found = [one.reshape(*one.shape[:-1], size, runs) for one in found]
        return tuple(jnp.moveaxis(one, -2, 0) for one in found), every

    return call
