"""Receding-horizon sweep with time on the last axis; its gradient along predicted trajectories.

The state carries a 1 behind it, so that H holds g in its last column, K = [F, -f] and Q = [[Q, -Q
y_d], [-y_d' Q, .]]. With M = [A B], one stage back is a product with constant matrices and an
elimination of the p inputs:

    Hz = M' H_{j+1} M,   G = (Hz_uu + R)^-1,   K_j = G Hz_ux,   H_j = Hz_xx - Hz_xu K_j + C' Q_j C
Hz is linear in H: its upper triangle, for all steps at once, is one matrix product for every two
axes that nothing couples.

Derivative: at the optimum the gains do not move the cost. With the closed loop A_j = A - B K_j,

    dH_j = A_j' dH_{j+1} A_j + K_j' dR K_j + C' dQ_j C,   dK_0 = G (B' dH_1 A_0 - dR K_0)
so a cotangent Kbar of K_0 reaches stage j as two bundles of p predicted trajectories instead of a
matrix of H's size:

    U_1 = B G,  V_1 = A_0 Kbar',  U_{j+1} = A_j U_j,  V_{j+1} = A_j V_j;   Qbar_j = C U_j V_j' C',
    Rbar += K_j U_j V_j' K_j'
"""

from functools import partial, reduce
from operator import add
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant, Pattern
from jcontour.riccati.packed_stage import (
    cost_in_front,
    extended,
    packed_cost,
    packed_stage,
    packing,
    seen_entries,
    stage_maps,
)

BLOCK = 512  # steps swept together: their numbers stay in a core's second-level cache


class SweepData(NamedTuple):
    """Data of the sweep besides the model.

    `cost` has the entries of [Q, -Q y_d] of every sample.
    """

    cost: Float[Array, "q S"]
    stage: Float[Array, " N_p"]
    R: Float[Array, "p p"]
    H: Float[Array, "T n n"]
    g: Float[Array, "T n"]


class Gains(NamedTuple):
    """Gain K_0, the K_j of the later stages, and G of the first control."""

    first: Float[Array, "p n+1 T"]
    later: Float[Array, "later p n+1 T"]
    G: Float[Array, "p p T"]


def window_plan(
    model: LinearPlant, data: SweepData
) -> tuple[Float[Array, "T p n"], Float[Array, "T p"]]:
    """Gains F, f of `riccati.receding_horizon_plan`.

    Q, R and H have to be symmetric. Where the pattern is False, the model has to be zero.
    """
    given = model.pattern, model.A, model.B, model.C
    cost, preview = data.cost, data.stage.shape[0]
    steps = cost.shape[1] - preview
    count = -(-steps // max(BLOCK, 2 * preview))
    if count == 1:
        return _plan(*given, data)
    length = -(-steps // count)
    idle = count * length - steps  # steps without cost, swept to make the blocks equal

    def cut(values):
        whole = jnp.pad(values, ((0, idle), *[(0, 0)] * (values.ndim - 1)))
        return whole.reshape(count, length, *values.shape[1:])

    def plan(block):
        window, H, g = block
        return _plan(*given, data._replace(cost=window, H=H, g=g))

    # samples that a block of steps looks at: its own, and the preview ahead of its last
    cost = jnp.pad(cost, ((0, 0), (0, idle)))
    own, end = cost[:, : count * length].reshape(-1, count, length), cost[:, None, count * length :]
    ahead = jnp.concatenate([own[:, 1:, : end.shape[2]], end], axis=1)
    windows = jnp.concatenate([own, ahead], axis=2).swapaxes(0, 1)
    F, f = jax.lax.map(plan, (windows, cut(data.H), cut(data.g)))
    return F.reshape(-1, *F.shape[2:])[:steps], f.reshape(-1, *f.shape[2:])[:steps]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _plan(pattern: Pattern, A, B, C, data: SweepData):
    return _in_time(pattern, _sweep(pattern, stage_maps(pattern, A, B, C), data))


@partial(_plan.defjvp, symbolic_zeros=True)
def _plan_jvp(pattern: Pattern, primals, tangents):
    *model, data = primals
    # a model that is identified: differentiate the sweep itself
    if not all(_still(tangent) for tangent in tangents[:3]):

        def swept(A, B, C, data):
            return _in_time(pattern, _sweep(pattern, stage_maps(pattern, A, B, C), data))

        def dense(tangent):
            return jnp.zeros(tangent.shape, tangent.dtype) if _still(tangent) else tangent

        return jax.jvp(swept, primals, jax.tree.map(dense, tangents, is_leaf=_still))
    given = tangents[3]._asdict()
    moved = {name: t for name, t in given.items() if t is not None and not _still(t)}
    maps = stage_maps(pattern, *model)
    gains = _sweep(pattern, maps, data)
    plan = _in_time(pattern, gains)

    @jax.jit  # traced once, used three times
    def forward(moved):
        def plan_of(some):
            return _in_time(pattern, _sweep(pattern, maps, data._replace(**some)))

        start = {name: getattr(data, name) for name in moved}
        return jax.jvp(plan_of, (start,), (moved,))[1]

    def backward(cotangent):
        bar = _trajectories(pattern, *model, data, gains, *cotangent)
        return {name: getattr(bar, name) for name in moved}

    if not moved:
        return plan, jax.tree.map(jnp.zeros_like, plan)
    return plan, linear_map(forward, backward, moved, plan)


def _still(tangent) -> bool:
    return isinstance(tangent, SymbolicZero)


def linear_map(forward, backward, x, like):
    """Map forward(x), shaped as `like`, with `backward` as its transpose.

    It is expressed as a block of the inverse of [[I, 0], [-forward, I]]:
    `jax.lax.custom_linear_solve` then supplies batching and derivatives.
    """

    def plus(first, second):
        return jax.tree.map(jnp.add, first, second)

    # zero, but linear in x, as all of a right-hand side has to be
    nothing = jnp.sum(jax.tree.leaves(x)[0].ravel()[:0])

    def zeros(entry):
        return jnp.broadcast_to(nothing.astype(entry.dtype), entry.shape)

    return jax.lax.custom_linear_solve(
        lambda z: (z[0], jax.tree.map(jnp.subtract, z[1], forward(z[0]))),
        (x, jax.tree.map(zeros, like)),
        lambda _, z: (z[0], plus(z[1], forward(z[0]))),
        lambda _, z: (plus(z[0], backward(z[1])), z[1]),
    )[1]


def _in_time(pattern: Pattern, gains: Gains):
    """Gains F, f with time in front and the states in the plant's order."""
    back = np.argsort(packing(pattern).order)
    return gains.first[:, back].transpose(2, 0, 1), -gains.first[:, -1].T


def _sweep(pattern: Pattern, maps, data: SweepData) -> Gains:
    """Gains of all steps."""
    pack, preview = packing(pattern), data.stage.shape[0]
    steps = data.cost.shape[1] - preview

    def back(H, stage):
        j, scale = stage
        cost = scale * jax.lax.dynamic_slice_in_dim(data.cost, j, steps, axis=1)
        packed = packed_stage(pack, maps, data.R, H)
        return cost_in_front(pack, maps, packed, cost), jnp.stack(packed.K)

    H = packed_cost(pack, data.H, data.g)
    stages = jnp.arange(1, preview), data.stage[:-1]
    H, later = jax.lax.scan(back, H, stages, reverse=True)
    first = packed_stage(pack, maps, data.R, H)
    G = jnp.stack([jnp.stack(row) for row in first.G])
    return Gains(jnp.stack(first.K), later, G)


def _trajectories(
    pattern: Pattern, A, B, C, data: SweepData, gains: Gains, F_bar, f_bar
) -> SweepData:
    """Cotangents of the data, from those of the plan."""
    pack = packing(pattern)
    A, B, C = extended(pack.order, A, B, C)
    (size, p), preview = B.shape, data.stage.shape[0]
    steps = data.cost.shape[1] - preview
    # (W, K W) to the next W, to C W and to K W: XLA would compute K W again for every use
    ahead, output = jnp.concatenate([A, -B], axis=1), jnp.pad(C, ((0, 0), (0, p)))
    along = jnp.concatenate([ahead, output, jnp.eye(p, size + p, size, A.dtype)])
    # N_p = 1 has no later gains, and a gather wants a row to look at
    later = (gains.later if preview > 1 else gains.first).reshape(-1, steps)

    def step(carry, stage):
        W, Q_bar, R_bar = carry
        j, scale = stage
        # a slice would be fused, and not vectorised
        rows = (j - 1) * p * size + np.arange(p * size)
        K = later[rows].reshape(p, size, steps)
        W = _through(along, jnp.concatenate([W[:size], _applied(K, W)]))
        Q_bar, scale_bar = _weighed_back(data, Q_bar, W[size:-p], j, scale)
        return (W, Q_bar, R_bar + _paired(W[-p:, :p], W[-p:, p:])), scale_bar

    K_bar = jnp.concatenate([F_bar[:, :, pack.order], -f_bar[:, :, None]], axis=2)
    K_bar = K_bar.transpose(2, 1, 0)
    KK_bar = _applied(gains.first, K_bar)
    U = jnp.pad(_through(B, gains.G), ((0, along.shape[0] - size), (0, 0), (0, 0)))
    V = _through(along, jnp.concatenate([K_bar, KK_bar]))
    W, R_bar = jnp.concatenate([U, V], axis=1), -_paired(gains.G, KK_bar)
    stages = jnp.arange(1, preview), data.stage[:-1]
    start = W, jnp.zeros_like(data.cost), R_bar
    (W, Q_bar, R_bar), stage_bar = jax.lax.scan(step, start, stages)
    back = np.argsort(pack.order)  # the states in the model's order again
    end_bar = _paired(W[:size, :p], W[:size, p:])
    H_bar = (end_bar + end_bar.swapaxes(0, 1))[back][:, back].transpose(2, 0, 1) / 2
    g_bar, stage_bar = end_bar[back, -1].T, jnp.pad(stage_bar, (0, 1))
    return SweepData(Q_bar, stage_bar, jnp.sum(R_bar, axis=-1), H_bar, g_bar)


def _through(matrix, W):
    """Product of a matrix that is the same at all times with trajectories."""
    return (matrix @ W.reshape(W.shape[0], -1)).reshape(-1, *W.shape[1:])


def _applied(K, W):
    """Controls K W of trajectories."""
    return reduce(add, (K[:, i, None] * W[i][None] for i in range(K.shape[1])))


def _paired(U, V):
    """Product U V' of two bundles of p trajectories."""
    return reduce(add, (U[:, None, c] * V[None, :, c] for c in range(U.shape[1])))


def _weighed_back(data: SweepData, Q_bar, CW, j, scale):
    """Cotangents of the cost and of the scale of stage j, from the outputs of the trajectories."""
    p = data.R.shape[0]
    U, V = CW[:, :p], CW[:, p:]
    steps = CW.shape[-1]

    def entry(a: int, b: int):
        mirrored = U[b] * V[a] if a != b else 0
        return jnp.sum(U[a] * V[b] + mirrored, axis=0)

    rows = jnp.stack([entry(a, b) for a, b in seen_entries(len(CW) - 1).T.tolist()])
    scale_bar = jnp.sum(rows * jax.lax.dynamic_slice_in_dim(data.cost, j, steps, axis=1))
    before = jax.lax.dynamic_slice_in_dim(Q_bar, j, steps, axis=1)
    Q_bar = jax.lax.dynamic_update_slice_in_dim(Q_bar, before + scale * rows, j, axis=1)
    return Q_bar, scale_bar
