"""Metrics of an LQ contouring run by the kernels of `lq_kernels`, as a function of JAX.

It works under `jit`, `vmap` (any depth) and `shard_map`, and has first derivatives in both modes.
Those with respect to alpha, beta, rho and the stage profile come from kernels, any others from the
same metrics in plain JAX. A run depends on the three weights by two numbers only,

    kappa = (alpha + beta) / rho,   f = beta / (alpha + beta)
and the kernel `slopes` carries the tangents of both along with the run. A stage profile has N more,
and in float64 a GPU has no registers for two: there the kernel `adjoint` goes back along the run.
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

from jcontour._arrays import is_concrete
from jcontour._devices import on_gpu
from jcontour._kernels.lq_kernels import (
    LEAST_RATIO,
    LONGEST_PREVIEW,
    TILE,
    Size,
    lq_kernel,
    output_rows,
)
from jcontour._kernels.parts import BLOCK, NORMS, VECTORS
from jcontour.linear.plant import LinearPlant, decoupled_axes, operating_point
from jcontour.motion.references import Reference
from jcontour.riccati.decoupled import ContouringProblem, axis_windows
from jcontour.riccati.window_sweep import linear_map
from jcontour.simulation.closed_loop import start_state
from jcontour.simulation.metrics import Metrics, scored_samples

wp.config.quiet = True  # pyright: ignore[reportAttributeAccessIssue]
REAL = {"float32": wp.float32, "float64": wp.float64}
MOST_STATES = 16  # of an axis: loops over more are not unrolled
# metrics in the order of the kernels' rows; `duration` and `diverged` come beside them
COMPUTED = [f"{size}_{name}" for size in ("rms", "peak") for name in VECTORS]


def computes_every_metric() -> bool:
    """Whether the kernels compute every metric; where not, runs are left to plain JAX."""
    return Metrics.__dataclass_fields__.keys() <= {*COMPUTED, "duration", "diverged"}


def suits(problem: ContouringProblem, plant: LinearPlant, reference: Reference) -> bool:
    """Whether the kernels take a run: lines and arcs, a short preview, uncoupled axes."""
    axes = decoupled_axes(plant.pattern)
    types = {str(leaf.dtype) for leaf in (problem.y_d, plant.A, problem.model.A, problem.alpha)}
    return (
        computes_every_metric()
        and problem.preview <= LONGEST_PREVIEW
        and axes == decoupled_axes(problem.model.pattern)
        and max(len(axis.states) for axis in axes) <= MOST_STATES
        and not reference.contour.newton_steps  # lines and arcs need none
        and len(types) == 1
        and types <= REAL.keys()
    )


def metrics(
    problem: ContouringProblem,
    plant: LinearPlant,
    reference: Reference,
    window: tuple[int, int] | None,
    in_jax: Callable[[ContouringProblem, LinearPlant, Reference], Metrics],
) -> Metrics:
    """Metrics of a run of `plant` under the receding-horizon law of `problem`.

    Args:
        problem: its weights are those of the run.
        plant: the machine, with the axes of the model.
        reference: of the run.
        window: samples a..b-1 that are scored; all when not given.
        in_jax: the same metrics in plain JAX, for derivatives with respect to anything else.
    """
    weights, stage = (problem.alpha, problem.beta, problem.rho), problem.stage
    unweighted = eqx.tree_at(_weights_of, problem, (None,) * 4, is_leaf=_is_none)
    constants, tree = jax.tree.flatten((unweighted, plant, reference))

    def run_of(weights, stage, constants) -> tuple[ContouringProblem, LinearPlant, Reference]:
        problem, *rest = jax.tree.unflatten(tree, constants)
        return eqx.tree_at(_weights_of, problem, (*weights, stage), is_leaf=_is_none), *rest

    @jax.custom_jvp
    def primal(weights, stage, constants) -> Metrics:
        run = run_of(weights, stage, constants)
        return metrics_of_rows(_launch(*run, window, "run"), reference, window)[0]

    @partial(primal.defjvp, symbolic_zeros=True)
    def _(primals, tangents):
        if not all(isinstance(leaf, SymbolicZero) for leaf in tangents[2]):
            dense = jax.tree.map(
                _dense, primals, tangents, is_leaf=lambda leaf: isinstance(leaf, SymbolicZero)
            )
            return jax.jvp(lambda *some: in_jax(*run_of(*some)), primals, dense)
        run = run_of(*primals)
        tangent = _law_tangent(primals[0], map(_dense, primals[0], tangents[0]))
        constant_stage = stage is None or isinstance(tangents[1], SymbolicZero)
        if constant_stage and not (on_gpu() and plant.A.dtype == jnp.float64):
            rows = _launch(*run, window, "slopes")
            value, scale = metrics_of_rows(rows, run[2], window)
            slopes = rows[2 * NORMS + 1 :].reshape(2, 2 * NORMS)
            change = (slopes[0] * tangent[0] + slopes[1] * tangent[1]) * scale
        else:
            rows = _launch(*run, window, "storing_run")
            value, scale = metrics_of_rows(rows, run[2], window)
            N = problem.preview
            roots = jnp.zeros(N) if constant_stage else 0.5 * tangents[1] / primals[1]
            tangent = jnp.concatenate([tangent, roots.astype(tangent.dtype)])  # of logarithms

            def transposed(bar: Float[Array, " rows"]) -> Float[Array, " slopes"]:
                return _launch(*run, window, "adjoint", (bar * scale, rows))[: 2 + N]

            def forward(tangent: Float[Array, " slopes"]) -> Float[Array, " rows"]:
                return jax.lax.map(transposed, jnp.eye(2 * NORMS, dtype=rows.dtype)) @ tangent

            change = linear_map(forward, transposed, tangent, scale)
        return value, Metrics(
            **dict(zip(COMPUTED, change, strict=True)),
            duration=jnp.zeros_like(value.duration),
            diverged=np.zeros((), jax.dtypes.float0),
        )

    return primal(weights, stage, constants)


def _weights_of(problem: ContouringProblem) -> tuple:
    return problem.alpha, problem.beta, problem.rho, problem.stage


def _is_none(leaf: Any) -> bool:
    return leaf is None


def _law_tangent(weights, tangents) -> Float[Array, "2"]:
    """Tangents of log kappa and of f."""
    alpha, beta, rho = weights
    d_alpha, d_beta, d_rho = tangents
    q = alpha + beta
    return jnp.stack(
        [(d_alpha + d_beta) / q - d_rho / rho, (d_beta * alpha - d_alpha * beta) / q**2]
    )


def _dense(like, tangent):
    """A tangent as an array."""
    if not isinstance(tangent, SymbolicZero):
        return tangent
    if jnp.issubdtype(jnp.result_type(like), jnp.floating):
        return jnp.zeros_like(like)
    return np.zeros(jnp.shape(like), jax.dtypes.float0)


def scoring_rows(
    tangent: Float[Array, "S m"],
    y_d: Float[Array, "S m"],
    reference: Reference,
    window: tuple[int, int] | None,
    dtype,
) -> list[Array]:
    """Arrays `path`, flat, and `contour` of `parts.scoring`, for a contour of lines and arcs."""
    contour = reference.contour
    scored = jnp.pad(scored_samples(reference, window), (0, len(y_d) - reference.steps))
    path = tangent, y_d, reference.arc[: len(y_d)], scored
    path = jnp.column_stack([columns.astype(dtype) for columns in path])
    pieces = [contour.polynomial[:, 0], contour.polynomial[:, 1], contour.cosine, contour.sine]
    pieces = jnp.column_stack([*pieces, contour.rate, contour.start, contour.extent])
    whole = contour.length, contour.size, contour.closed, jnp.sum(contour.mask)
    whole = jnp.stack([jnp.asarray(number, dtype) for number in whole])
    whole = jnp.pad(whole, (0, pieces.shape[1] - len(whole)))
    return [path.ravel(), jnp.concatenate([whole[None], pieces.astype(dtype)])]


def metrics_of_rows(
    rows: Float[Array, " rows"], reference: Reference, window: tuple[int, int] | None
) -> tuple[Metrics, Float[Array, " metrics"]]:
    """Metrics from sums and peaks of squares, and their derivatives with half of these."""
    mask = scored_samples(reference, window)
    count = jnp.maximum(jnp.sum(mask), 1).astype(rows.dtype)
    pairs = jnp.maximum(jnp.sum(mask[1:] & mask[:-1]), 1).astype(rows.dtype)
    means = jnp.stack([count] * (NORMS - 1) + [pairs] + [jnp.ones_like(count)] * NORMS)
    root = jnp.sqrt(rows[: 2 * NORMS] / means)
    scale = jnp.where(root > 0, 1 / (means * jnp.where(root > 0, root, 1)), 0)
    duration = jnp.sum(mask).astype(rows.dtype) * reference.dt
    numbers = dict(zip(COMPUTED, root, strict=True))
    return Metrics(**numbers, duration=duration, diverged=rows[2 * NORMS] != 0), scale


def _launch(
    problem: ContouringProblem,
    plant: LinearPlant,
    reference: Reference,
    window: tuple[int, int] | None,
    kernel: str,
    inputs: tuple[Array, ...] = (),
) -> Array:
    """Output of a kernel for one run, from its own inputs; a `vmap` of it is one launch."""
    N, dtype, double = problem.preview, plant.A.dtype, jnp.result_type(float)
    axes = decoupled_axes(plant.pattern)
    n = max(len(axis.states) for axis in axes)
    horizons = axis_windows(problem.model, N)  # of each axis: y = O x + G U
    q = problem.alpha + problem.beta
    weights = [q / problem.rho, jnp.maximum(problem.beta / q, LEAST_RATIO)]
    weights += [] if problem.stage is None else list(problem.stage)
    G = jnp.stack([horizon.G for horizon in horizons]).astype(double)
    if problem.stage is not None:
        responses = (G,)
    else:  # the singular values of the forced responses, once a machine
        U, sigma, V = np.linalg.svd(np.asarray(G)) if is_concrete(G) else jnp.linalg.svd(G)
        responses = jnp.asarray(U), jnp.asarray(sigma**2), jnp.asarray(sigma * V[:, :, 0])

    def padded(entries):
        """Entries of an axis's states in the last dimension, with zeros up to n."""
        return jnp.pad(entries, [(0, 0)] * (entries.ndim - 1) + [(0, n - entries.shape[-1])])

    rest = operating_point(problem.model, reference.position[0])
    state = start_state(plant, reference)
    rows = []  # of each axis: A, B, C, O, and the response at rest, the control there, the state
    for axis, horizon, y in zip(axes, horizons, rest.position, strict=True):
        states, entry = np.array(axis.states), axis.inputs[0]
        A = jnp.pad(plant.A[np.ix_(states, states)], [(0, n - len(states)), (0, 0)])
        parts = [A, plant.B[states, entry], plant.C[axis.outputs[0], states], horizon.O]
        parts = [padded(part) for part in parts]
        parts += [horizon.O @ rest.state[states] - y, rest.control[entry], padded(state[states])]
        rows.append(parts)
    model = [jnp.stack(part).astype(dtype).ravel() for part in zip(*rows, strict=True)]
    scoring = scoring_rows(problem.tangent, problem.y_d, reference, window, dtype)
    shared = *responses, jnp.concatenate(model), *scoring
    size = Size(len(axes), n, N, REAL[str(dtype)], problem.stage is not None)
    per_run = jnp.stack(weights).astype(double), *inputs
    (rows,) = _batched_launch(size, kernel)(tuple(one[:, None] for one in per_run), *shared)
    return rows[:, 0]


@lru_cache
def _batched_launch(size: Size, kernel: str):
    """Function of a run's weights and inputs (rows, runs), responses, and the shared arrays."""
    launch = wp.jax_kernel(lq_kernel(kernel, size), block_dim=BLOCK)

    def call(per_run, *shared):
        weights, *inputs = per_run
        *responses, model, path, contour = shared
        steps = len(path) // (2 * size.m + 2) - size.N
        shape = output_rows(kernel, size, steps), weights.shape[1]
        dims = {"launch_dims": shape[1], "output_dims": {"out": shape}}
        design = _design(weights, responses, model.dtype)
        return tuple(launch(design, model, path, contour, *inputs, **dims))

    return batched_over_runs(call)


def _design(weights: Float[Array, "rows runs"], responses, dtype) -> Float[Array, " numbers"]:
    """Array `design` of `lq_kernel`.

    M = (I + kappa G G')^-1 and h, the first column of G, are those of `lq_kernels`. The responses
    are G (m, N, N) where there is a stage profile, else its singular vectors and values.
    """
    kappa, f, *stage = weights
    i, j = np.tril_indices(responses[0].shape[1])
    roots = jnp.sqrt(weights[2:])
    if stage:
        (G,) = responses
        G = jnp.moveaxis(roots, 1, 0)[:, None, :, None] * G[None]
        identity = jnp.eye(G.shape[-1])[None, None]
        whole = jnp.linalg.inv(identity + kappa[:, None, None, None] * G @ G.mT)
        column = kappa[:, None, None] * jnp.einsum("baij,baj->bai", whole, G[..., 0])
        M, Mh = jnp.moveaxis(whole[:, :, i, j], 0, -1), jnp.moveaxis(column, 0, -1)
    else:
        U, square, h = responses
        values = 1 / (1 + kappa[None, None] * square[..., None])
        column = h[..., None] / (1 / kappa[None, None] + square[..., None])
        M = jnp.einsum("apq,aqb->apb", U[:, i] * U[:, j], values)
        Mh = jnp.einsum("aiq,aqb->aib", U, column)
    runs = len(kappa)
    rows = [f[None], (f[None, None] * M).reshape(-1, runs), Mh.reshape(-1, runs), roots]
    rows = jnp.concatenate(rows).astype(dtype)
    rows = jnp.pad(rows, ((0, 0), (0, -runs % TILE)))
    return rows.reshape(len(rows), -1, TILE).swapaxes(0, 1).ravel()


def batched_over_runs(launch: Callable[..., tuple[Array, ...]]) -> Callable[..., tuple[Array, ...]]:
    """Function of arrays with the runs behind, and of arrays that all runs share, under `vmap`.

    A batch of runs is one launch. Where what they share differs, it is one after the other.
    """

    @custom_vmap
    def call(per_run, *shared):
        return launch(per_run, *shared)

    @call.def_vmap
    def batch_rule(size, batched, per_run, *shared):
        if any(batched[1:]):
            arguments, tree = jax.tree.flatten((per_run, shared))
            has_axis = jax.tree.leaves(batched)

            def member(moving):
                rest = iter(moving)
                own = [next(rest) if b else a for a, b in zip(arguments, has_axis, strict=True)]
                per_run, shared = jax.tree.unflatten(tree, own)
                return call(per_run, *shared)

            moving = [a for a, b in zip(arguments, has_axis, strict=True) if b]
            outputs = jax.lax.map(member, moving)
            return outputs, (True,) * len(outputs)

        def flat_batch(rows, has_axis):
            rows = rows if has_axis else jnp.broadcast_to(rows[None], (size, *rows.shape))
            return jnp.moveaxis(rows, 0, -2).reshape(*rows.shape[1:-1], -1)

        runs = per_run[0].shape[-1]
        outputs = call(tuple(map(flat_batch, per_run, batched[0])), *shared)
        outputs = [rows.reshape(*rows.shape[:-1], size, runs) for rows in outputs]
        return tuple(jnp.moveaxis(rows, -2, 0) for rows in outputs), (True,) * len(outputs)

    return call
