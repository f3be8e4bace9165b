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
from jcontour._kernels.lq_kernels import LEAST_RATIO, LONGEST_PREVIEW, SEGMENT, TILE, kernels
from jcontour._kernels.parts import BLOCK, NORMS, VECTORS
from jcontour.geometry.contours import Contour
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


def computes_all() -> bool:
    """Whether the kernels compute every metric; where not, runs are left to plain JAX."""
    return Metrics.__dataclass_fields__.keys() <= {*COMPUTED, "duration", "diverged"}


def suits(problem: ContouringProblem, plant: LinearPlant, reference: Reference) -> bool:
    """Whether the kernels take a run: lines and arcs, a short preview, uncoupled axes."""
    axes = decoupled_axes(plant.pattern)
    types = {str(leaf.dtype) for leaf in (problem.y_d, plant.A, problem.model.A, problem.alpha)}
    return (
        computes_all()
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
    weights = problem.alpha, problem.beta, problem.rho
    stage = problem.stage
    kept = eqx.tree_at(_weights_of, problem, (None,) * 4, is_leaf=_is_none)
    others, tree = jax.tree.flatten((kept, plant, reference))

    def rebuilt(weights, stage, others) -> tuple[ContouringProblem, LinearPlant, Reference]:
        problem, *rest = jax.tree.unflatten(tree, others)
        return eqx.tree_at(_weights_of, problem, (*weights, stage), is_leaf=_is_none), *rest

    @jax.custom_jvp
    def of(weights, stage, others) -> Metrics:
        run = rebuilt(weights, stage, others)
        (out,) = _launched(*run, window, "run")
        return finished(out, run[2], window)[0]

    @partial(of.defjvp, symbolic_zeros=True)
    def _(primals, tangents):
        if not all(isinstance(leaf, SymbolicZero) for leaf in tangents[2]):
            dense = jax.tree.map(_dense, primals, tangents, is_leaf=_is_leaf)
            return jax.jvp(lambda *some: in_jax(*rebuilt(*some)), primals, dense)
        run = rebuilt(*primals)
        N, moved = problem.preview, _moved(primals[0], map(_dense, primals[0], tangents[0]))
        constant_stage = stage is None or isinstance(tangents[1], SymbolicZero)
        if constant_stage and not (on_gpu() and plant.A.dtype == jnp.float64):
            out, slope = _launched(*run, window, "slopes")
            value, half = finished(out, run[2], window)
            change = (slope[0] * moved[0] + slope[1] * moved[1]) * half
        else:
            out, states = _launched(*run, window, "keeping_run")
            value, half = finished(out, run[2], window)
            roots = jnp.zeros(N) if constant_stage else 0.5 * tangents[1] / primals[1]
            moved = jnp.concatenate([moved, roots.astype(moved.dtype)])  # of their logarithms

            def back(bar: Float[Array, " rows"]) -> Float[Array, " slopes"]:
                return _launched(*run, window, "adjoint", (bar * half, out, states))[0]

            def ahead(moved: Float[Array, " slopes"]) -> Float[Array, " rows"]:
                return jax.lax.map(back, jnp.eye(2 * NORMS, dtype=out.dtype)) @ moved

            change = linear_map(ahead, back, moved, half)
        return value, Metrics(
            **dict(zip(COMPUTED, change, strict=True)),
            duration=jnp.zeros_like(value.duration),
            diverged=np.zeros((), jax.dtypes.float0),
        )

    return of(weights, stage, others)


def _weights_of(problem: ContouringProblem) -> tuple:
    return problem.alpha, problem.beta, problem.rho, problem.stage


def _moved(weights, tangents) -> Float[Array, "2"]:
    """Tangents of log kappa and of f."""
    alpha, beta, rho = weights
    d_alpha, d_beta, d_rho = tangents
    q = alpha + beta
    return jnp.stack(
        [(d_alpha + d_beta) / q - d_rho / rho, (d_beta * alpha - d_alpha * beta) / q**2]
    )


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


def contour_rows(contour: Contour, dtype) -> list[Array]:
    """Pieces of a contour of lines and arcs, and its length, size, closedness, number of pieces."""
    pieces = [contour.polynomial[:, 0], contour.polynomial[:, 1], contour.cosine, contour.sine]
    pieces += [row[:, None] for row in (contour.rate, contour.start, contour.extent)]
    whole = contour.length, contour.size, contour.closed, jnp.sum(contour.mask)
    whole = jnp.stack([jnp.asarray(number, dtype) for number in whole])
    return [jnp.concatenate(pieces, axis=1).astype(dtype), whole]


def finished(
    out: Float[Array, " rows"], reference: Reference, window: tuple[int, int] | None
) -> tuple[Metrics, Float[Array, " rows"]]:
    """Metrics from sums and peaks of squares, and their slopes with half of these."""
    mask = scored_samples(reference, window)
    count = jnp.maximum(jnp.sum(mask), 1).astype(out.dtype)
    pairs = jnp.maximum(jnp.sum(mask[1:] & mask[:-1]), 1).astype(out.dtype)
    means = jnp.stack([count] * (NORMS - 1) + [pairs] + [jnp.ones_like(count)] * NORMS)
    root = jnp.sqrt(out[: 2 * NORMS] / means)
    half = jnp.where(root > 0, 1 / (means * jnp.where(root > 0, root, 1)), 0)
    duration = jnp.sum(mask).astype(out.dtype) * reference.dt
    numbers = dict(zip(COMPUTED, root, strict=True))
    return Metrics(**numbers, duration=duration, diverged=out[2 * NORMS] != 0), half


def _launched(
    problem: ContouringProblem,
    plant: LinearPlant,
    reference: Reference,
    window: tuple[int, int] | None,
    kernel: str,
    rows: tuple[Array, ...] = (),
) -> tuple[Array, ...]:
    """Outputs of a kernel for one run, from rows of its own; a `vmap` of it is one launch."""
    N, dtype, double = problem.preview, plant.A.dtype, jnp.result_type(float)
    axes = decoupled_axes(plant.pattern)
    n, steps = max(len(axis.states) for axis in axes), reference.steps
    horizons = axis_windows(problem.model, N)  # of each axis: y = O x + G U
    q = problem.alpha + problem.beta
    own = [q / problem.rho, jnp.maximum(problem.beta / q, LEAST_RATIO)]
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
    ahead = jnp.stack([jnp.pad(one.O, ((0, 0), (0, n - one.O.shape[1]))) for one in horizons])
    at = operating_point(problem.model, reference.position[0])
    inputs = np.array([axis.inputs[0] for axis in axes])
    held = [one.O @ at.state[np.array(a.states)] for one, a in zip(horizons, axes, strict=True)]
    rest = jnp.stack(held) - at.position[:, None]
    shared = [
        A.ravel(), B.ravel(), C.ravel(), ahead.ravel(),
        problem.tangent.T.ravel(), problem.y_d.T.ravel(), rest.ravel(),
        at.control[inputs], reference.arc[:steps],
        scored_samples(reference, window).astype("int32"),
        jnp.stack([padded(a, state) for a in range(len(axes))]),
        *contour_rows(reference.contour, dtype),
    ]  # fmt: skip
    shared = [one if one.dtype == "int32" else one.astype(dtype) for one in shared]
    call = _caller((len(axes), n, N), str(dtype), kernel, problem.stage is not None)
    G = jnp.stack([one.G for one in horizons]).astype(double)
    own = own, *(one[..., None] for one in rows)
    return tuple(one[..., 0] for one in call(own, *_responses(G, problem.stage), *shared))


def _padded(states, n: int, a: int, row):
    """Entries of an axis's states, with zeros up to n."""
    own = row[np.array(states[a])]
    return jnp.pad(own, [(0, n - len(own)), *[(0, 0)] * (own.ndim - 1)])


def _responses(G: Float[Array, "m N N"], stage) -> tuple[Array, ...]:
    """Forced responses G; without a stage profile their singular values, once a machine."""
    if stage is not None:
        return (G,)
    if is_concrete(G):
        U, sigma, V = np.linalg.svd(np.asarray(G))
    else:
        U, sigma, V = jnp.linalg.svd(G)
    return jnp.asarray(U), jnp.asarray(sigma**2), jnp.asarray(sigma * V[:, :, 0])


def _designed(own: Float[Array, "rows runs"], responses, dtype) -> list[Array]:
    """Numbers of each run: f, lower triangles of f M, kappa M h, roots of the stage profile.

    M = (I + kappa G G')^-1 and h, the first column of G, are those of `lq_kernels`.
    """
    kappa, ratio, *stage = own
    i, j = np.tril_indices(responses[0].shape[1])
    if stage:
        (G,), scale = responses, jnp.sqrt(own[2:])
        G = jnp.moveaxis(scale, 1, 0)[:, None, :, None] * G[None]
        identity = jnp.eye(G.shape[-1])[None, None]
        whole = jnp.linalg.inv(identity + kappa[:, None, None, None] * G @ G.mT)
        column = kappa[:, None, None] * jnp.einsum("baij,baj->bai", whole, G[..., 0])
        M, Mh = jnp.moveaxis(whole[:, :, i, j], 0, -1), jnp.moveaxis(column, 0, -1)
    else:
        U, square, h = responses
        scale = jnp.zeros((0, 0))
        values = 1 / (1 + kappa[None, None] * square[..., None])
        column = h[..., None] / (1 / kappa[None, None] + square[..., None])
        M = jnp.einsum("apq,aqb->apb", U[:, i] * U[:, j], values)
        Mh = jnp.einsum("aiq,aqb->aib", U, column)
    rows = ratio[None], _tiled(ratio[None, None] * M), _tiled(Mh), scale
    return [one.astype(dtype) for one in rows]


def _tiled(rows: Float[Array, "*rows runs"]) -> Float[Array, " numbers"]:
    """Numbers of `TILE` runs side by side, one row after the other."""
    rows = rows.reshape(-1, rows.shape[-1])
    rows = jnp.pad(rows, ((0, 0), (0, -rows.shape[1] % TILE)))
    return rows.reshape(len(rows), -1, TILE).swapaxes(0, 1).ravel()


@lru_cache
def _caller(size: tuple[int, int, int], dtype: str, kernel: str, staged: bool):
    """Function of a run's rows (rows, runs) and the shared arrays; see `kernels`."""
    (m, n, N), parts = size, 1 if staged else 3
    chosen = getattr(kernels(*size, REAL[dtype], staged), kernel)
    launch = wp.jax_kernel(chosen, num_outputs=2, block_dim=BLOCK)

    def shapes(runs: int, steps: int) -> dict[str, tuple[int, ...]]:
        """Shapes of the kernel's outputs."""
        kept = m * steps + m * n * -(-steps // SEGMENT)
        return {
            "run": {"out": (3 * NORMS + 1, runs), "kept": (1, 1)},
            "keeping_run": {"out": (3 * NORMS + 1, runs), "kept": (kept, runs)},
            "slopes": {"out": (2 * NORMS + 1, runs), "slope": (2, 2 * NORMS, runs)},
            "adjoint": {"slope": (2 + N, runs), "states": (m * n * SEGMENT, runs)},
        }[kernel]

    def call(own, *shared):
        weights, *more = own
        runs, steps = weights.shape[1], len(shared[parts + 8])
        rows = _designed(weights, shared[:parts], dtype)
        placed = {"launch_dims": runs, "output_dims": shapes(runs, steps)}
        outputs = tuple(launch(*rows, *shared[parts:], *more, **placed))
        return outputs[:1] if kernel in ("run", "adjoint") else outputs

    return over_runs(call)


def over_runs(launch: Callable[..., tuple[Array, ...]]) -> Callable[..., tuple[Array, ...]]:
    """Function of arrays with the runs behind, and of arrays that all runs share, under `vmap`.

    A batch of runs is one launch. Where what they share differs, it is one after the other.
    """

    @custom_vmap
    def call(own, *shared):
        return launch(own, *shared)

    @call.def_vmap
    def more(size, batched, own, *shared):
        if any(batched[1:]):
            given, tree = jax.tree.flatten((own, shared))
            moves = jax.tree.leaves(batched)

            def one(moving):
                rest = iter(moving)
                member = [next(rest) if b else a for a, b in zip(given, moves, strict=True)]
                own, shared = jax.tree.unflatten(tree, member)
                return call(own, *shared)

            outputs = jax.lax.map(one, [a for a, b in zip(given, moves, strict=True) if b])
            return outputs, (True,) * len(outputs)

        def side_by_side(rows, moves):
            rows = rows if moves else jnp.broadcast_to(rows[None], (size, *rows.shape))
            return jnp.moveaxis(rows, 0, -2).reshape(*rows.shape[1:-1], -1)

        runs = own[0].shape[-1]
        outputs = call(tuple(map(side_by_side, own, batched[0])), *shared)
        outputs = [one.reshape(*one.shape[:-1], size, runs) for one in outputs]
        return tuple(jnp.moveaxis(one, -2, 0) for one in outputs), (True,) * len(outputs)

    return call
