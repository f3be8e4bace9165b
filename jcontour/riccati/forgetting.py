"""A long horizon from a short one, where the loop forgets what lies beyond, and a check of that.

The cost to go at a step hardly depends on what lies beyond M samples once the product of the
closed loops' transitions over them has died out. The run is cut into as many blocks as are swept at
once, of L steps. Each is swept from M samples behind its end, to one step more in front than it
has. That step is the last one of the block before, where that block's sweep has M samples and this
one M + L. The two gains of the same step are compared, F and f each by itself, relative to the
largest gain; the other steps of a block have more than M samples.

Where L is short, the path stands still, or the horizon ends in the stationary cost, there is little
difference to see. So the product of the transitions that lie behind every block within its horizon
has to have died out too, to the same number: by its square an error of the cost at the end arrives
at the block.
A loop that forgets slowly, as that of very expensive control, is found by these two, whatever its
weights are: nothing is estimated beforehand.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour._devices import on_gpu
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.riccati.blockwise import remembering_sweep
from jcontour.riccati.receding_horizon import MOST_STATES, CostToGo

MEMORY = 250  # M [samples]: within them the paper's weights have forgotten
WIDTH = 8  # blocks that a CPU's vector unit sweeps at once
FORGOTTEN = 1e-12  # relative difference of gains: rounding over so many stages is 1e-14


def suits_forgetting(preview: int, model: LinearPlant) -> bool:
    """Whether the short sweep is worth it: a preview of 2 M, in float64, on a CPU.

    In float32 nothing is forgotten to `FORGOTTEN`. A GPU is filled by the blocks of a batch, and
    `vmap` would sweep both there.
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

    Only the one that is needed is computed. Under `vmap` that is `whole` for all members unless all
    of them have forgotten.

    Args:
        model: A, B, C; at most `MOST_STATES` states.
        Q: output weight at every sample, at least 2 M of them behind the run.
        y_d: desired output at every sample [m].
        R: control weight.
        terminal_at: cost to go at these samples.
        whole: makes the plan of the long horizon.
        steps: T.
    """
    length = block_length(steps, y_d.shape[0] - steps - MEMORY)
    short, apart = short_plan(model, Q, y_d, R, terminal_at, steps, MEMORY, length)
    forgotten = jax.lax.stop_gradient(apart) <= FORGOTTEN  # not so where it is NaN
    return jax.lax.cond(_by_all(forgotten), lambda: short, whole)


@jax.custom_batching.custom_vmap
def _by_all(true: Bool[Array, ""]) -> Bool[Array, ""]:
    """Whether it is true of every member of a batch, one answer for all of them."""
    return true


@_by_all.def_vmap
def _by_all_of_a_batch(size: int, batched: list[bool], true):
    del size, batched
    return _by_all(jnp.all(true)), False


def block_length(steps: int, most: int) -> int:
    """Steps of a block L, at most so many.

    The blocks, with the one behind the run, are a multiple of those that are swept at once.
    """
    together = WIDTH * -(-(steps + most) // (WIDTH * most))
    return -(-steps // (together - 1))


def short_plan(
    model: LinearPlant,
    Q: Float[Array, "S m m"],
    y_d: Float[Array, "S m"],
    R: Float[Array, "p p"],
    terminal_at: Callable[[slice], CostToGo],
    steps: int,
    memory: int,
    length: int,
) -> tuple[AffinePlan, Float[Array, ""]]:
    """Gains of blocks of L = `length` steps, and what their sweeps may not have forgotten.

    The largest relative difference at their ends, or what a sweep remembers over M = `memory`.

    One block more is swept behind the run: the last step of the run is compared too.
    """
    swept = steps + length
    first = swept % -length - 1  # the first block may begin before the run, in front of it a step
    begins = np.arange(first, steps, length)
    seen = jnp.maximum(jnp.add.outer(jnp.arange(length + memory), begins), 0)
    terminal = terminal_at(slice(first + length + memory, swept + memory, length))
    F, f, product = remembering_sweep(
        model.pattern, seen, length + 1, model.A, model.B, model.C, Q, y_d, R, *terminal
    )
    remembered = jnp.max(jnp.abs(product))
    apart = jnp.max(jnp.stack([_apart(F), _apart(f), remembered]))
    return AffinePlan(*(_in_time(one, steps, swept) for one in (F, f))), apart


def _apart(rows: Float[Array, "rows blocks *rest"]) -> Float[Array, ""]:
    """Difference of the gains of the same steps over the largest gain."""
    difference = jnp.max(jnp.abs(rows[-1, :-1] - rows[0, 1:]))
    largest = jnp.max(jnp.abs(rows))
    return jnp.where(difference > 0, difference / jnp.where(largest > 0, largest, 1), difference)


def _in_time(rows, steps: int, swept: int):
    """Rows of all blocks in the order of the run, without those of idle steps and behind it."""
    own = rows[1:].swapaxes(0, 1)
    return own.reshape(-1, *rows.shape[2:])[-swept:][:steps]
