"""Metrics of many runs on a GPU: the numbers of `simulation.metrics.score_signals` by a kernel.

A lane sums the squares of a stretch of one run and keeps their peaks, so that every signal is read
once. The derivative is that of the readable metrics.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array

from jcontour.kernels.arithmetic import dot
from jcontour.kernels.gpu.contour_lanes import LaneContour, contour_rows, squared
from jcontour.kernels.gpu.lanes import LANES, Batch, Lanes, Operand, launch

FILLED = 2**19  # lanes that keep a GPU busy
SHORTEST = 16  # samples of a stretch
SQUARES = 5  # of contour, projected and tracking errors, of controls and of their increments


class Sizes(NamedTuple):
    """Static sizes: outputs, inputs, steps, samples of a stretch, pieces; is any of them an arc?"""

    m: int
    p: int
    steps: int
    stretch: int
    pieces: int
    turns: bool

    @property
    def stretches(self) -> int:
        """Stretches of a run."""
        return -(-self.steps // self.stretch)


class Found(NamedTuple):
    """Numbers of a stretch so far: sums and peaks of the squares, and 1 if a sample is lost."""

    sums: tuple[Array, ...]
    peaks: tuple[Array, ...]
    lost: Array


def kernel(sizes: Sizes, batch: Batch, reach: float, *refs):
    """What the lanes' stretches come to."""
    operands, (sums, peaks, lost) = refs[: len(batch.axes)], refs[len(batch.axes) :]
    lanes = Lanes.of(pl.program_id(0), sizes.stretches, batch.members)
    y, u, position, tangent, arc, mask, size, *pieces = batch.rows(operands, lanes.member)
    contour = LaneContour.read(pieces, sizes.m, sizes.pieces, sizes.turns)
    begin, size = lanes.step * sizes.stretch, size.fixed(0)
    nothing = jnp.full(lanes.number.shape, 0.0, y.ref.dtype)

    def sample(i, state):
        found, before, seen = state
        k = jnp.minimum(begin + i, sizes.steps - 1)
        scored = (mask.sample(0, k) > 0) & (begin + i < sizes.steps)
        point = [y.sample(a, k) for a in range(sizes.m)]
        control = [u.sample(a, k) for a in range(sizes.p)]
        error = [value - position.sample(a, k) for a, value in enumerate(point)]
        along_path = [tangent.sample(a, k) for a in range(sizes.m)]
        lag = dot(zip(error, along_path, strict=True))
        across = [e - lag * t for e, t in zip(error, along_path, strict=True)]
        near = squared(error) <= size * size
        # a diverged sample is not worth a search
        window = jnp.where(near, reach * jnp.sqrt(squared(error)), 0.0)
        increment = [now - last for now, last in zip(control, before, strict=True)]
        nearest = contour.square(point, arc.sample(0, k), window)
        # least and largest numbers leave out NaN on a GPU
        squares = [jnp.where(squared(error) >= 0, nearest, jnp.nan)]
        squares += [squared(vector) for vector in (across, error, control, increment)]
        counted = [scored] * (SQUARES - 1) + [scored & seen]
        for value in control:
            near = near & (jnp.abs(value) < jnp.inf)
        return _gathered(found, squares, counted, scored & ~near), tuple(control), scored

    k = jnp.maximum(begin - 1, 0)  # in front of the stretch: its first increment is from there
    before = tuple(u.sample(a, k) + nothing for a in range(sizes.p))
    seen = (mask.sample(0, k) > 0) & (begin > 0)
    zeros = (nothing,) * SQUARES
    state = Found(zeros, zeros, nothing), before, seen
    found, *_ = jax.lax.fori_loop(0, sizes.stretch, sample, state)
    for row in range(SQUARES):
        sums[row, lanes.number], peaks[row, lanes.number] = found.sums[row], found.peaks[row]
    lost[0, lanes.number] = found.lost


def _gathered(found: Found, squares: list, counted: list, lost) -> Found:
    squares = [jnp.where(there, value, 0.0) for there, value in zip(counted, squares, strict=True)]
    sums = tuple(total + value for total, value in zip(found.sums, squares, strict=True))
    peaks = tuple(
        jnp.maximum(most, value) for most, value in zip(found.peaks, squares, strict=True)
    )
    return Found(sums, peaks, jnp.where(lost, 1.0, found.lost))


def lane_metrics(
    reach: float, window: tuple[int, int], y: Operand, u: Operand, reference: Any
) -> list[Operand]:
    """Numbers of `Metrics` of every run, in their order, the flag as a number.

    Args:
        reach: of the search for the nearest point, times the tracking error.
        window: samples a..b-1 that are scored.
        y: outputs (m, T).
        u: controls (p, T).
        reference: a `Reference` of operands, on a contour without Newton's steps.
    """
    (m, steps), contour, mask = y.core, reference.contour, _scored(reference.mask, y, window)
    samples = reference.position, reference.tangent, reference.arc, mask
    timed = [y, u, *(_time_last(rows, steps) for rows in samples)]
    fixed = [contour.size, *contour_rows(contour)]
    operands = [rows.timed() for rows in timed] + [rows.fixed() for rows in fixed]
    operands = [Operand(rows.array.astype(y.array.dtype), rows.axes) for rows in operands]
    batch = Batch.of((*timed, *fixed))
    stretch = max(-(-steps * batch.members // FILLED), min(SHORTEST, steps))
    sizes = Sizes(m, u.core[0], steps, stretch, contour.rate.core[0], contour.turns)
    lanes, run = sizes.stretches * batch.members, partial(kernel, sizes, batch, reach)
    found = launch(run, -(-lanes // LANES), operands, [(SQUARES, lanes)] * 2 + [(1, lanes)])
    sums, peaks, lost = (part.reshape(-1, sizes.stretches, *batch.sizes) for part in found)
    peaks = jnp.where(jnp.isnan(sums), sums, peaks)

    def count(there):
        return Operand(jnp.sum(there, axis=0), mask.axes).over(batch).array

    samples, pairs = count(mask.array), count(mask.array[1:] * mask.array[:-1])
    counts = jnp.stack([samples] * (SQUARES - 1) + [pairs])
    means = jnp.sum(sums, axis=1) / jnp.maximum(counts, 1)
    both = jnp.stack([jnp.sqrt(means), jnp.sqrt(jnp.max(peaks, axis=1))], axis=1)
    numbers = both.reshape(2 * SQUARES, *batch.sizes)
    numbers = [*numbers, samples * reference.dt, jnp.max(lost[0], axis=0)]
    return [Operand(number, batch.together) for number in numbers]


def _scored(mask: Operand, like: Operand, window: tuple[int, int]) -> Operand:
    """Samples that are scored (T,), as numbers of the type of `like`."""
    steps = like.core[-1]
    index = jnp.expand_dims(jnp.arange(steps), tuple(range(1, mask.array.ndim)))
    there = mask.array[:steps] & (index >= window[0]) & (index < window[1])
    return Operand(there.astype(like.array.dtype), mask.axes)


def _time_last(rows: Operand, steps: int) -> Operand:
    """Rows of the first steps, (T,) or (row, T)."""
    array = rows.array[:steps]
    return Operand(array if len(rows.core) == 1 else jnp.moveaxis(array, 0, 1), rows.axes)
