"""The Riccati sweep of a horizon that stays while a block of samples is run, then moves on.

A receding horizon of N_p samples costs N_p stages at every sample. Here the horizon ends at one
sample for N_p steps: the first of them sees 2 N_p - 1 samples, the last one N_p. One backward sweep
gives the gains of them all, so a sample costs two stages, however far it sees:

    (H, g) at the end from the terminal cost, then eqs. 12 and 13 of McNab & Tsao down to the first
    step of the block; eq. 11 at each of its steps
The blocks are swept side by side, and the last one ends with the run. A run of at most N_p steps is
one block: its gains are those of the whole path, the limit of every receding horizon.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour.linear.plant import AffinePlan, LinearPlant, Pattern
from jcontour.riccati.packed_stage import (
    cost_entries,
    cost_in_front,
    packed_cost,
    packed_stage,
    stage_maps,
)
from jcontour.riccati.packing import packing
from jcontour.riccati.receding_horizon import (
    MOST_STATES,
    CostToGo,
    first_control,
    one_stage_back,
)


def block_ends(steps: int, preview: int) -> slice:
    """Samples that the blocks' horizons end at, in the order of the blocks."""
    return slice((steps - 1) % preview + preview, steps + preview, preview)


def blockwise_plan(
    model: LinearPlant,
    Q: Float[Array, "S m m"],
    y_d: Float[Array, "S m"],
    R: Float[Array, "p p"],
    terminal: CostToGo,
    preview: int,
) -> AffinePlan:
    """Gains F, f (u = f - F x) of every step of a run.

    Args:
        model: A, B, C.
        Q: output weight at every sample, S = T + N_p.
        y_d: desired output at every sample [m].
        R: control weight.
        terminal: cost to go at the samples of `block_ends`, blocks in front.
        preview: samples N_p of a block.
    """
    if model.states > MOST_STATES:
        return swept(preview, model, Q, y_d, R, terminal)
    steps, matrices = Q.shape[0] - preview, (model.A, model.B, model.C)
    data = _seen(steps, preview), preview, *matrices, Q, y_d, R, *terminal
    F, f = block_sweep(model.pattern, *data)
    return AffinePlan(_in_time(F, steps), _in_time(f, steps))


def block_sweep(
    pattern: Pattern, seen: Int[Array, "seen blocks"], preview: int, A, B, C, Q, y_d, R, H, g
) -> tuple[Float[Array, "N_p blocks p n"], Float[Array, "N_p blocks p"]]:
    """Gains F, f of the steps of every block.

    Args:
        pattern: non-zeros of the model.
        seen: samples of every block, its steps first, then those ahead of its last step.
        preview: steps N_p of a block.
        A: (n, n).
        B: (n, p).
        C: (m, n).
        Q: output weight at every sample (S, m, m).
        y_d: desired output at every sample (S, m) [m].
        R: control weight (p, p).
        H: cost to go at the end of every block's horizon (blocks, n, n).
        g: likewise (blocks, n).
    """
    cost = cost_entries(Q, y_d)[:, seen]
    return _gains(pattern, _packed_sweep(pattern, preview, A, B, C, cost, R, H, g))


def remembering_sweep(
    pattern: Pattern, seen: Int[Array, "seen blocks"], preview: int, A, B, C, Q, y_d, R, H, g
) -> tuple[
    Float[Array, "N_p blocks p n"], Float[Array, "N_p blocks p"], Float[Array, "blocks n n"]
]:
    """Gains as those of `block_sweep`, and what each block's sweep remembers of (H, g).

    That is the product of A - B F of the stages behind the block's steps, the last one on the left;
    the order of the states is of no account. It has no derivative.
    """
    cost = cost_entries(Q, y_d)[:, seen]
    F, f = _gains(pattern, _packed_sweep(pattern, cost.shape[1], A, B, C, cost, R, H, g))

    def on(product, F):
        return (A[None] - jnp.einsum("np,bpm->bnm", B, F)) @ product, None

    start = jnp.broadcast_to(jnp.eye(len(A), dtype=F.dtype), H.shape)
    behind = jax.lax.stop_gradient(F[preview:])
    return F[:preview], f[:preview], jax.lax.scan(on, start, behind)[0]


def _gains(pattern: Pattern, K):
    K = jnp.moveaxis(K, -1, 1)
    return K[..., np.argsort(packing(pattern).order)], -K[..., -1]


def _packed_sweep(
    pattern: Pattern, preview: int, A, B, C, cost: Float[Array, "q seen blocks"], R, H, g
) -> Float[Array, "N_p p size blocks"]:
    """Gains K = [F, -f] of the first samples; the states are in the order of `packing`."""
    pack, maps = packing(pattern), stage_maps(pattern, A, B, C)
    rows = jnp.moveaxis(cost, 1, 0)

    def back(H, cost):
        found = packed_stage(pack, maps, R, H)
        return cost_in_front(pack, maps, found, cost), jnp.stack(found.K)

    def ahead(H, cost):
        return back(H, cost)[0], None

    first, _ = jax.lax.scan(ahead, packed_cost(pack, H, g), rows[preview:], reverse=True)
    return jax.lax.scan(back, first, rows[:preview], reverse=True)[1]


def swept(preview: int, model: LinearPlant, Q, y_d, R, terminal: CostToGo) -> AffinePlan:
    """Plan of `blockwise_plan` as the equations say it; the faster forms are tested equal to it."""
    steps = Q.shape[0] - preview
    seen = _seen(steps, preview)

    def back(cost: CostToGo, sample: Int[Array, " blocks"]):
        plan = first_control(model, R, cost)
        return one_stage_back(model, R, cost, Q[sample], y_d[sample]), plan

    def ahead(cost: CostToGo, sample: Int[Array, " blocks"]):
        return one_stage_back(model, R, cost, Q[sample], y_d[sample]), None

    first, _ = jax.lax.scan(ahead, terminal, seen[preview:], reverse=True)
    _, plan = jax.lax.scan(back, first, seen[:preview], reverse=True)
    return jax.tree.map(lambda rows: _in_time(rows, steps), plan)


def _seen(steps: int, preview: int) -> Int[Array, "seen blocks"]:
    """Samples of every block, its steps first, then those ahead of its last step.

    The first block may begin before the run; its idle steps look at sample 0.
    """
    blocks = -(-steps // preview)
    begins = steps - preview * jnp.arange(blocks, 0, -1)
    return jnp.maximum(jnp.add.outer(jnp.arange(2 * preview - 1), begins), 0)


def _in_time(rows: Float[Array, "N_p blocks *rest"], steps: int) -> Float[Array, "T *rest"]:
    """Rows of all blocks in the order of the run, without those of idle steps."""
    return rows.swapaxes(0, 1).reshape(-1, *rows.shape[2:])[-steps:]
