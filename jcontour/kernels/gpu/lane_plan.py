"""Plan of `riccati.receding_horizon_plan` from the GPU kernels, with its derivative.

The kernels differentiate with respect to weights, stage profile, desired outputs and terminal.
Where the model itself moves (it is identified, say), the derivative is that of `window_sweep`.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.kernels.gpu.gain_cotangents import cotangents
from jcontour.kernels.gpu.gain_lanes import gains
from jcontour.kernels.gpu.lanes import dense
from jcontour.kernels.packed_stage import cost_entries
from jcontour.kernels.sweeps.window_sweep import window_plan
from jcontour.kernels.written_stage import Sizes, shape_of
from jcontour.linear.plant import Pattern

UNROLLED = 32  # stages whose cotangents are gathered in one pass


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def lane_plan(
    pattern: Pattern, A, B, C, Q, y_d, stage, R, end
) -> tuple[Float[Array, "T p n"], Float[Array, "T p"]]:
    """Gains F, f of `riccati.receding_horizon_plan`.

    `end` is (H, g), or () where the last sample is weighted like the others.
    """
    sizes = _sizes(A, B, C, Q, stage, end)
    F, f = gains(pattern, sizes)(A, B, C, cost_entries(Q, y_d), stage, R, *_ends(end))
    return jnp.transpose(F, (2, 0, 1)), f.T


def _plan_fwd(pattern: Pattern, *arguments):
    values = jax.tree.map(lambda leaf: leaf.value, arguments)
    moves = any(leaf.perturbed for leaf in arguments[:3])
    return lane_plan(pattern, *values), (values, () if moves else None)


def _plan_bwd(pattern: Pattern, kept, cotangent):
    arguments, moves = kept
    A, B, C, Q, y_d, stage, R, end = arguments
    steps = Q.shape[0] - stage.shape[0]
    F_bar, f_bar = (dense(bar) for bar in cotangent)
    if moves is not None:
        _, pull = jax.vjp(partial(_swept, pattern), *arguments)
        return pull((F_bar, f_bar))
    sizes, stage = _sizes(A, B, C, Q, stage, end), jnp.asarray(stage)
    cost, pull = jax.vjp(cost_entries, Q, y_d)
    bars = jnp.transpose(F_bar, (1, 2, 0)), f_bar.T
    rows, R_bar, ends = cotangents(pattern, sizes)(A, B, C, cost, stage, R, *_ends(end), *bars)
    seen = [cost[:, j : j + steps] for j in range(1, sizes.weighed + 1)]
    stage_bar = [jnp.sum(row * window) for row, window in zip(rows, seen, strict=True)]
    stage_bar += [jnp.zeros((), cost.dtype)] * sizes.ended
    Q_bar, y_d_bar = pull(_gathered(rows, stage, cost.shape[1]))
    weights_bar = jnp.stack(stage_bar), jnp.sum(R_bar, axis=-1)
    return None, None, None, Q_bar, y_d_bar, *weights_bar, _end_bar(pattern, sizes, ends)


lane_plan.defvjp(_plan_fwd, _plan_bwd, symbolic_zeros=True)


def _end_bar(pattern: Pattern, sizes: Sizes, ends: Float[Array, "e T"]) -> tuple[Array, ...]:
    """Cotangent of the terminal (H, g), where there is one."""
    if not sizes.ended:
        return ()
    upper, g_bar = ends[: -sizes.n], ends[-sizes.n :]
    H_bar = jnp.zeros((sizes.steps, sizes.n, sizes.n), ends.dtype)
    for entry, (i, k) in zip(upper, shape_of(pattern).entries, strict=False):
        H_bar = H_bar.at[:, i, k].set(entry).at[:, k, i].set(entry)
    return H_bar, g_bar.T


def _gathered(
    rows: Float[Array, "w q T"], stage: Float[Array, " N_p"], samples: int
) -> Float[Array, "q S"]:
    """Cotangent of the cost: every sample from all the steps that saw it."""
    weighed, q, steps = rows.shape
    gathered = jnp.zeros((q, samples), rows.dtype)
    if weighed <= UNROLLED:
        for j in range(weighed):
            place = (0, 0), (j + 1, samples - steps - j - 1)
            gathered = gathered + jnp.pad(stage[j] * rows[j], place)
        return gathered

    def one_stage(j, gathered):
        before = jax.lax.dynamic_slice_in_dim(gathered, j + 1, steps, axis=1)
        after = before + stage[j] * rows[j]
        return jax.lax.dynamic_update_slice_in_dim(gathered, after, j + 1, axis=1)

    return jax.lax.fori_loop(0, weighed, one_stage, gathered)


def _swept(pattern: Pattern, A, B, C, Q, y_d, stage, R, end):
    """Plan by `window_sweep`; without a terminal it begins one sample later, from no cost."""
    if end:
        return window_plan(pattern, A, B, C, Q, y_d, stage, R, *end)
    nothing = jnp.zeros((Q.shape[0] - stage.shape[0], A.shape[0] + 1, A.shape[0]), A.dtype)

    def one_more(array):
        return jnp.pad(array, ((0, 1), *[(0, 0)] * (array.ndim - 1)))

    Q, y_d, stage = one_more(Q), one_more(y_d), one_more(stage)
    return window_plan(pattern, A, B, C, Q, y_d, stage, R, nothing[:, 1:], nothing[:, 0])


def _sizes(A, B, C, Q, stage, end) -> Sizes:
    preview = stage.shape[0]
    return Sizes(A.shape[0], B.shape[1], C.shape[0], Q.shape[0] - preview, preview, bool(end))


def _ends(end):
    return [jnp.moveaxis(array, 0, -1) for array in end]
