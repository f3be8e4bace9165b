"""The receding-horizon Riccati sweep over a whole run at once.

At every step k the finite-horizon problem over j = 1..N_p is solved backward from its terminal cost
(H, g):

    K_j = (B' H_{j+1} B + R)^-1 B' H_{j+1} A
    H_j = A' H_{j+1} (A - B K_j) + C' Q_j C
    g_j = (A - B K_j)' g_{j+1} - C' Q_j y_d(k+j)
    u(k) = -(B' H_1 B + R)^-1 B' (H_1 A x(k) + g_1)
McNab & Tsao, eqs. 11-13, with the minus of (11) and (12) restored and H_{j+1}, g_{j+1} throughout.
The gains depend on the future of the reference only, never on the state. All steps are therefore
swept together: axis T in front, j the only loop.

A receding horizon of N_p samples costs N_p stages at every sample. Blockwise, the horizon ends at
one sample for N_p steps and then moves on: the first of them sees 2 N_p - 1 samples, the last one
N_p. One backward sweep gives the gains of them all, so a sample costs two stages, however far it
sees. The blocks are swept side by side, and the last one ends with the run. A run of at most N_p
steps is one block: its gains are those of the whole path, the limit of every receding horizon.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.linear.small_matrices import small_inverse
from jcontour.riccati.packed_stage import (
    cost_entries,
    cost_in_front,
    packed_cost,
    packed_stage,
    packing,
    stage_maps,
)
from jcontour.riccati.window_sweep import SweepData, window_plan

MOST_STATES = 20  # of the fast sweep; its matrices grow with the fourth power


class CostToGo(NamedTuple):
    """Cost that remains: x' H x + 2 g' x."""

    H: Float[Array, "T n n"]
    g: Float[Array, "T n"]


def receding_horizon_plan(
    model: LinearPlant,
    Q: Float[Array, "S m m"],
    y_d: Float[Array, "S m"],
    stage: Float[Array | np.ndarray, " N_p"],
    R: Float[Array, "p p"],
    terminal: CostToGo | None,
) -> AffinePlan:
    """Gains F, f (u = f - F x) of every step of a run, for any machine.

    The horizon is swept stage by stage (`riccati.window_sweep`). Short windows of decoupled axes
    need no sweep: see `riccati.decoupled`. Long ones are cheaper by `blockwise_plan`.

    Args:
        model: A, B, C.
        Q: output weight at every sample, S = T + N_p.
        y_d: desired output at every sample [m].
        stage: profile over the horizon that scales Q_j, j = 1..N_p-1 (entry N_p belongs to the
            terminal); traced, or known.
        R: control weight.
        terminal: cost to go at j = N_p for every step, T in front. None: sample N_p has the
            ordinary weight, stage[N_p] Q, and S needs to be T + N_p exactly.
    """
    seen = Q.shape[0] if terminal is None else terminal.g.shape[0] + stage.shape[0]
    Q, y_d = Q[:seen], y_d[:seen]  # the reference may look further ahead than the controller
    stage = jnp.asarray(stage)
    if terminal is None:
        cost = output_cost(model, Q[stage.shape[0] :], y_d[stage.shape[0] :])
        terminal = CostToGo(stage[-1] * cost.H, stage[-1] * cost.g)
    if model.states > MOST_STATES:
        return readable_plan(model, Q, y_d, stage, R, terminal)
    F, f = window_plan(model, SweepData(cost_entries(Q, y_d), stage, R, *terminal))
    return AffinePlan(F, f)


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
    steps, pack = Q.shape[0] - preview, packing(model.pattern)
    maps = stage_maps(model.pattern, model.A, model.B, model.C)
    # samples of every block, its steps first, then those ahead of its last step; the first block
    # may begin before the run, and its idle steps look at sample 0
    begins = steps - preview * jnp.arange(-(-steps // preview), 0, -1)
    seen = jnp.maximum(jnp.add.outer(jnp.arange(2 * preview - 1), begins), 0)
    rows = jnp.moveaxis(cost_entries(Q, y_d)[:, seen], 1, 0)

    def back(H, cost):
        stage = packed_stage(pack, maps, R, H)
        return cost_in_front(pack, maps, stage, cost), jnp.stack(stage.K)

    def ahead(H, cost):
        return back(H, cost)[0], None

    end = packed_cost(pack, *terminal)
    first, _ = jax.lax.scan(ahead, end, rows[preview:], reverse=True)
    # K = [F, -f] (N_p, p, n + 1, blocks), the states in the order of `packing`
    _, K = jax.lax.scan(back, first, rows[:preview], reverse=True)
    K = jnp.moveaxis(K, -1, 1)
    F = K[..., np.argsort(pack.order)]
    return AffinePlan(_in_time(F, steps), _in_time(-K[..., -1], steps))


def _in_time(rows: Float[Array, "N_p blocks *rest"], steps: int) -> Float[Array, "T *rest"]:
    """Rows of all blocks in the order of the run, without those of idle steps."""
    return rows.swapaxes(0, 1).reshape(-1, *rows.shape[2:])[-steps:]


def readable_plan(
    model: LinearPlant,
    Q: Float[Array, "S m m"],
    y_d: Float[Array, "S m"],
    stage: Float[Array, " N_p"],
    R: Float[Array, "p p"],
    terminal: CostToGo,
) -> AffinePlan:
    """Gains of every step as the equations say it, stage by stage.

    The definition: `window_sweep` and `decoupled` are tested equal to it. For a machine that
    changes along the path, A_j, B_j, C_j are those of sample k + j: `model` is then stacked over
    all S samples.
    """
    steps, preview = terminal.g.shape[0], stage.shape[0]
    Q, y_d, stage = jnp.asarray(Q), jnp.asarray(y_d), jnp.asarray(stage)  # NumPy has no index j
    changing = model.A.ndim == 3

    def at(rows, j):
        return jax.tree.map(lambda leaf: jax.lax.dynamic_slice_in_dim(leaf, j, steps), rows)

    def sweep(cost, j):
        Q_j, y_j = at((Q, y_d), j)
        model_j = at(model, j) if changing else model
        return one_stage_back(model_j, R, cost, stage[j - 1] * Q_j, y_j), None

    first, _ = jax.lax.scan(sweep, terminal, jnp.arange(preview - 1, 0, -1))
    return first_control(at(model, 0) if changing else model, R, first)


def output_cost(model: LinearPlant, Q: Float[Array, "T m m"], y_d: Float[Array, "T m"]) -> CostToGo:
    """Cost to go (y - y_d)' Q (y - y_d) of one sample.

    It is the last stage of eqs. 12 and 13, with the minus of g restored.
    """
    return CostToGo(model.C.T @ Q @ model.C, -jnp.einsum("tij,tj->ti", Q, y_d) @ model.C)


def one_stage_back(
    model: LinearPlant, R, cost: CostToGo, Q_j: Float[Array, "T m m"], y_j: Float[Array, "T m"]
) -> CostToGo:
    """Cost to go (H_j, g_j) from (H_{j+1}, g_{j+1}): eqs. 12 and 13.

    There is one model for all steps, or one for each.
    """
    A, B, C = model.A, model.B, model.C
    K, _ = _gain(model, R, cost)
    closed = A.reshape(-1, *A.shape[-2:]) - B @ K  # a time axis of one where A is for all steps
    H = A.mT @ cost.H @ closed + C.mT @ Q_j @ C
    g = _apply(closed.mT, cost.g) - _apply(C.mT, _apply(Q_j, y_j))
    return CostToGo((H + H.mT) / 2, g)


def first_control(model: LinearPlant, R, cost: CostToGo) -> AffinePlan:
    """Control u = f - F x that minimises one step plus the cost to go: eq. 11."""
    F, f = _gain(model, R, cost)
    return AffinePlan(F, f)


def _gain(
    model: LinearPlant, R, cost: CostToGo
) -> tuple[Float[Array, "T p n"], Float[Array, "T p"]]:
    BH = model.B.mT @ cost.H
    inverse = small_inverse(BH @ model.B + R[None])
    return inverse @ (BH @ model.A), -_apply(inverse, _apply(model.B.mT, cost.g))


def _apply(matrices: Float[Array, "*T a b"], vectors: Float[Array, "T b"]) -> Float[Array, "T a"]:
    return jnp.einsum("...ij,...j->...i", matrices, vectors)
