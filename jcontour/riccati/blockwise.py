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

from jcontour.linear.plant import AffinePlan, LinearPlant
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
    steps, pack = Q.shape[0] - preview, packing(model.pattern)
    maps = stage_maps(model.pattern, model.A, model.B, model.C)
    rows = jnp.moveaxis(cost_entries(Q, y_d)[:, _seen(steps, preview)], 1, 0)

    def back(H, cost):
        found = packed_stage(pack, maps, R, H)
        return cost_in_front(pack, maps, found, cost), jnp.stack(found.K)

    def ahead(H, cost):
        return back(H, cost)[0], None

    end = packed_cost(pack, *terminal)
    first, _ = jax.lax.scan(ahead, end, rows[preview:], reverse=True)
    # K = [F, -f] (N_p, p, n + 1, blocks), the states in the order of `packing`
    _, K = jax.lax.scan(back, first, rows[:preview], reverse=True)
    K = jnp.moveaxis(K, -1, 1)
    F = K[..., np.argsort(pack.order)]
    return AffinePlan(_in_time(F, steps), _in_time(-K[..., -1], steps))


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
