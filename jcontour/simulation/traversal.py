"""Time and contour error of a tool whose controller chose the speed itself."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.geometry.contour import Contour

# times step and error: where a tool cuts a corner of 28 degrees, its nearest point jumps so far
REACH = 8.0
BLOCK = 1024  # samples: runs end at different ones, and share programs of whole blocks
END_MARGIN = 0.5e-3  # [m] before the end of the path: there the run counts as done


class Score(NamedTuple):
    """A run up to where its tool has passed the end of the path less the margin.

    The first sample, t = 0, does not count, the last one does.

    Attributes:
        time: until then [s]; NaN when the tool did not get there.
        rms: contour error [m].
        peak: largest contour error [m].
        arc: path parameter nearest to the tool [m], all samples of the run, laps unrolled.
        error: distance from the path [m], all samples.
    """

    time: float
    rms: float
    peak: float
    arc: Float[np.ndarray, " T"]
    error: Float[np.ndarray, " T"]


def traversal_score(
    contour: Contour,
    output: Float[ArrayLike, "T m"],
    dt: float,
    start: float = 0.0,
    margin: float = END_MARGIN,
    progress: Float[ArrayLike, " T"] | None = None,
) -> Score:
    """Time and contour error of a tool path.

    Args:
        contour: the path.
        output: tool points [m].
        dt: sample period [s].
        start: arc length at which it begins [m].
        margin: before the end of the path [m]: there the run counts as done.
        progress: (T,) where the controller holds the tool to be [m]. The nearest point is then
            sought around it, which finds its way around sharp corners; without it, it is sought
            around the one before.
    """
    steps = np.shape(output)[0]
    if progress is None:
        found = _followed(contour, _whole_blocks(output), jnp.asarray(float(start)))
    else:
        found = _around(contour, _whole_blocks(output), _whole_blocks(progress))
    arc, error = (np.asarray(values)[:steps] for values in found)
    there = np.flatnonzero(arc >= float(contour.length) - margin)
    last = int(there[0]) if there.size else len(arc) - 1
    counted = error[1 : last + 1]
    time = last * dt if there.size else np.nan
    return Score(time, float(np.sqrt(np.mean(counted**2))), float(counted.max()), arc, error)


def _whole_blocks(rows: ArrayLike) -> Float[Array, "..."]:
    """The rows, the last one again and again up to whole blocks."""
    rows = np.asarray(rows)
    index = np.minimum(np.arange(-(-len(rows) // BLOCK) * BLOCK), len(rows) - 1)
    return jnp.asarray(rows[index])


@jax.jit
def _followed(contour: Contour, output, start):
    """Nearest point of every sample, each sought around the one before.

    Start and end of a closed path coincide, laps unroll.
    """
    length = contour.length

    def advance(carry, samples):
        arc, error = carry
        before, here = samples
        reach = REACH * (jnp.linalg.norm(here - before) + error) + 1e-6 * length
        nearest = contour.nearest(here, arc, reach)
        arc = _unrolled(contour, arc, nearest)
        error = jnp.linalg.norm(here - contour.position(arc))
        return (arc, error), (arc, error)

    first = jnp.linalg.norm(output[0] - contour.position(start))
    before = jnp.concatenate([output[:1], output[:-1]])
    return jax.lax.scan(advance, (start, first), (before, output))[1]


@jax.jit
def _around(contour: Contour, output, progress):
    """Nearest point of every sample around a known progress."""
    gap = jnp.linalg.norm(output - contour.position(progress), axis=-1)
    nearest = contour.nearest(output, progress, REACH * gap + 1e-6 * contour.length)
    arc = _unrolled(contour, progress, nearest)
    return arc, jnp.linalg.norm(output - contour.position(arc), axis=-1)


def _unrolled(contour: Contour, arc, nearest):
    """The nearest point as an arc length on the lap that `arc` is on."""
    moved, length = nearest - contour.within(arc), contour.length
    return arc + jnp.where(contour.closed, moved - length * jnp.round(moved / length), moved)
