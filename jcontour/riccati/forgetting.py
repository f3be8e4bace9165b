"""A long horizon from a short one, where the loop forgets what lies beyond, and a check of that.

The cost to go at a step hardly depends on what lies beyond M samples once the product of the
closed loops' transitions over them has died out. Blocks of M steps are swept from M samples behind
their end, one step more in front than they have. That step is the last one of the block before,
where the sweep has M samples: here it has 2 M. The two gains of the same step differ by what the
sweep has not forgotten within M samples, and the other steps of a block have more than M.

The difference counts relative to the largest gain, F and f each by itself. Where the path stands
still, or the horizon ends in the stationary cost, there is none to see. So the product of the
closed loops' transitions over every block has to have died out too, to the same number.
A loop that forgets slowly, as that of very expensive control, is found by these two, whatever its
weights are: nothing is estimated beforehand.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.devices import on_gpu
from jcontour.kernels.sweeps.block_sweep import block_sweep
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.riccati.blockwise import block_ends
from jcontour.riccati.receding_horizon import MOST_STATES, CostToGo

MEMORY = 250  # M [samples]: within them the paper's weights have forgotten
FORGOTTEN = 1e-12  # relative difference of gains: rounding over so many stages is 1e-14


def suits_forgetting(preview: int, model: LinearPlant) -> bool:
    """Whether the short sweep is worth it: a preview of 2 M, in float64, on a CPU.

    In float32 nothing is forgotten to `FORGOTTEN`. A GPU fills its lanes with the blocks of a
    batch, and `vmap` would sweep both there.
    """
    double = model.A.dtype == jnp.float64
    return preview >= 2 * MEMORY and model.states <= MOST_STATES and double and not on_gpu()


def forgetful_plan(
    model: LinearPlant,
    Q: Float[Array, "S m m"],
    y_d: Float[Array, "S m"],
    R: Float[Array, "p p"],
    terminal_at: Callable[[slice], CostToGo],
    whole: Callable[[], AffinePlan],
    steps: int,
) -> AffinePlan:
    """The short sweep's gains where the loop has forgotten within `MEMORY`, else those of `whole`.

    Only the one that is needed is computed, but under `vmap`, where both are.

    Args:
        model: A, B, C; at most `MOST_STATES` states.
        Q: output weight at every sample, at least 2 M of them behind the run.
        y_d: desired output at every sample [m].
        R: control weight.
        terminal_at: cost to go at these samples.
        whole: makes the plan of the long horizon.
        steps: T.
    """
    short, apart = short_plan(model, Q, y_d, R, terminal_at, steps, MEMORY)
    forgotten = jax.lax.stop_gradient(apart) <= FORGOTTEN  # not so where it is NaN
    return jax.lax.cond(forgotten, lambda: short, whole)


def short_plan(
    model: LinearPlant,
    Q: Float[Array, "S m m"],
    y_d: Float[Array, "S m"],
    R: Float[Array, "p p"],
    terminal_at: Callable[[slice], CostToGo],
    steps: int,
    memory: int,
) -> tuple[AffinePlan, Float[Array, ""]]:
    """Gains of the blocks of M = `memory` steps, and what their sweeps may not have forgotten.

    The largest relative difference at their ends, or what the loop remembers over a block.

    One block more is swept behind the run: the last step of the run is compared too.
    """
    swept = steps + memory
    blocks = -(-swept // memory)
    begins = swept - memory * jnp.arange(blocks, 0, -1) - 1
    seen = jnp.maximum(jnp.add.outer(jnp.arange(2 * memory), begins), 0)
    terminal = terminal_at(block_ends(swept, memory))
    rows = block_sweep(
        model.pattern, seen, memory + 1, model.A, model.B, model.C, Q, y_d, R, *terminal
    )
    apart = jnp.max(jnp.stack([*map(_apart, rows), _remembered(model, rows[0][1:])]))
    return AffinePlan(*(_in_time(one, steps, swept) for one in rows)), apart


def _apart(rows: Float[Array, "rows blocks *rest"]) -> Float[Array, ""]:
    """Difference of the gains of the same steps over the largest gain."""
    difference = jnp.max(jnp.abs(rows[-1, :-1] - rows[0, 1:]))
    largest = jnp.max(jnp.abs(rows))
    return jnp.where(difference > 0, difference / jnp.where(largest > 0, largest, 1), difference)


def _remembered(model: LinearPlant, F: Float[Array, "M blocks p n"]) -> Float[Array, ""]:
    """Largest entry of the product of A - B F over the steps of a block."""

    def on(product, F):
        return (model.A[None] - jnp.einsum("np,bpm->bnm", model.B, F)) @ product, None

    start = jnp.broadcast_to(jnp.eye(model.states, dtype=F.dtype), (F.shape[1], *model.A.shape))
    return jnp.max(jnp.abs(jax.lax.scan(on, start, F)[0]))


def _in_time(rows, steps: int, swept: int):
    """Rows of all blocks in the order of the run, without those of idle steps and behind it."""
    own = rows[1:].swapaxes(0, 1)
    return own.reshape(-1, *rows.shape[2:])[-swept:][:steps]
