"""Time and contour error of a tool whose controller chose the speed itself."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.geometry.contour import Contour

# times step and error: where a tool cuts a corner of 28 degrees, its nearest point jumps so far
REACH = 8.0
RETURN = 0.02  # [rad] a corner as sharp as this is a way back along the same line
TIE = 1e-12  # of the path's length: points as near as this differ by rounding, the one ahead counts
BLOCK = 1024  # samples: runs end at different ones, and share programs of whole blocks
END_MARGIN = 0.5e-3  # [m] before the end of the path: there the run counts as done


class Score(NamedTuple):
    """A run up to where its tool has passed the end of the path less `END_MARGIN`.

    The first sample, t = 0, does not count, the last one does.
    """

    time: float  # until then [s]; NaN when the tool did not get there
    rms: float  # contour error [m]
    peak: float  # largest contour error [m]
    # path parameter nearest to the tool [m], all samples of the run, laps unrolled
    arc: Float[np.ndarray, " T"]
    error: Float[np.ndarray, " T"]  # distance from the path [m], all samples


def traversal_score(
    contour: Contour,
    output: Float[ArrayLike, "T m"],
    dt: float,
    start: float = 0.0,
) -> Score:
    """Time and contour error of a tool path.

    The tool is followed from sample to sample; where its controller holds it to be does not count.

    Args:
        contour: the path.
        output: tool points [m].
        dt: sample period [s].
        start: arc length at which it begins [m].
    """
    steps = np.shape(output)[0]
    times = jnp.asarray(_times(contour))
    # the rows, the last one again and again up to whole blocks
    rows = np.asarray(output)
    index = np.minimum(np.arange(-(-len(rows) // BLOCK) * BLOCK), len(rows) - 1)
    nearest = _followed(contour, jnp.asarray(rows[index]), jnp.asarray(float(start)), times)
    arc, error = (np.asarray(values)[:steps] for values in nearest)
    there = np.flatnonzero(arc >= float(contour.length) - END_MARGIN)
    last = int(there[0]) if there.size else len(arc) - 1
    counted = error[1 : last + 1]
    time = last * dt if there.size else np.nan
    return Score(time, float(np.sqrt(np.mean(counted**2))), float(counted.max()), arc, error)


def outrun(contour: Contour, score: Score, progress: Float[ArrayLike, " T"]) -> bool:
    """Whether the controller's progress came to the end of a path whose end its tool never reached.

    Args:
        contour: the path.
        score: of the run.
        progress: arc length at which the controller holds the tool to be [m].
    """
    there = float(np.max(np.asarray(progress))) >= float(contour.length) - END_MARGIN
    return there and not np.isfinite(score.time)


@jax.jit
def _followed(contour: Contour, output, start, times):
    """Nearest point of every sample, each sought around the one before, and the distance to it."""
    # no further than the tool may have moved; on a closed path no further than half a lap, as start
    # and end coincide there

    def advance(carry, samples):
        arc, error = carry
        before, here = samples
        reach = times * (jnp.linalg.norm(here - before) + error) + 1e-6 * contour.length
        (ahead, off), (behind, apart) = (
            _foot(contour, here, arc, reach, sense) for sense in (1.0, -1.0)
        )
        back = apart < off - TIE * contour.length  # a path may return along itself
        nearest = jnp.where(back, behind, ahead), jnp.where(back, apart, off)
        return nearest, nearest

    first = jnp.linalg.norm(output[0] - contour.position(start))
    before = jnp.concatenate([output[:1], output[:-1]])
    return jax.lax.scan(advance, (start, first), (before, output))[1]


def _foot(contour: Contour, here, arc, reach, sense):
    """Nearest point within reach to one side of `arc`, and the distance to it."""
    left = contour.length - arc if sense > 0 else arc
    half = 0.5 * jnp.minimum(reach, jnp.where(contour.closed, 0.5 * contour.length, left))
    middle = arc + sense * half
    # as an arc length on the lap that `arc` is on
    nearest = contour.nearest(here, middle, half)
    moved, length = nearest - contour.within(middle), contour.length
    foot = jnp.where(contour.closed, middle + moved - length * jnp.round(moved / length), nearest)
    return foot, jnp.linalg.norm(here - contour.position(foot))


def _times(contour: Contour) -> float:
    """How many times step and error a nearest point may jump, at the sharpest corner."""
    # the point of the other leg of a corner of angle a is 2 e / tan(a / 2) further; below `RETURN`
    # both legs count as one line
    mask = np.asarray(contour.mask)
    pieces = jax.tree.map(lambda rows: rows[mask], contour.pieces)
    ends = [np.asarray(pieces.jet(at)[1]) for at in (pieces.extent, 0.0 * pieces.extent)]
    before, after = (rows / np.linalg.norm(rows, axis=-1, keepdims=True) for rows in ends)
    turn = np.sum(before * np.roll(after, -1, axis=0), axis=-1)
    angle = np.pi - np.arccos(np.clip(turn, -1.0, 1.0))
    corners = angle if bool(contour.closed) else angle[:-1]
    sharpest = float(np.min(corners[corners > RETURN], initial=np.pi))
    return max(REACH, 2.0 / np.tan(0.5 * sharpest))
