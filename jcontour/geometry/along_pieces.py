"""Place, speed, acceleration and jerk of the axes along pieces, in NumPy arrays, by compiled loops.

With p(s) a piece and s(t) the motion along it:

    place          p(s)
    speed          p' v
    acceleration   p'' v^2 + p' a
    jerk           p''' v^3 + 3 p'' v a + p' j

At v = 1 and a = j = 0 they are the derivatives of the piece. Eight points are the lanes of a value.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jcontour._compiled import compiled
from jcontour._native import lanes
from jcontour._native.lanes import WIDTH, drop_stale, fma, load, part, spread, store
from jcontour.geometry.pieces import Piece

drop_stale(Path(__file__).parent, Path(lanes.__file__))


def in_rows(pieces: Piece) -> Float[np.ndarray, "P numbers"]:
    """A row for every piece: its rate, cosines and sines, and the polynomials, highest power first.

    One array is compiled sooner than four.
    """
    falling = pieces.polynomial[:, ::-1].reshape(len(pieces.rate), -1)
    return np.concatenate([pieces.rate[:, None], pieces.cosine, pieces.sine, falling], axis=1)


def in_lanes(
    numbers: Float[np.ndarray, "n k"],
    pieces: Piece,
    piece: Int[np.ndarray, " n"],
    point: Int[np.ndarray, " lanes"],
) -> Float[np.ndarray, "blocks entries 8"]:
    """Numbers of points and then the rows of their pieces, for eight points side by side.

    Args:
        numbers: of the points.
        pieces: of a path.
        piece: number of the piece of every point.
        point: number of the point in every lane; some multiple of eight.
    """
    low, high = int(piece.min()), int(piece.max()) + 1  # of long paths few pieces at a time
    own = in_rows(pieces.taken(slice(low, high)))[piece - low]
    rows = np.concatenate([numbers, own], axis=1)[point]
    return np.ascontiguousarray(rows.reshape(-1, WIDTH, rows.shape[1]).swapaxes(1, 2))


def filling(count: int) -> Int[np.ndarray, " lanes"]:
    """Points in lanes: one after the other, the last one fills what is left of eight."""
    return np.minimum(np.arange(-(-count // WIDTH) * WIDTH), count - 1)


@part
def wave(pieces, at, s, scratch):
    """Cosine and sine of pieces' waves at their own arc lengths [m]; their rows begin at `at`."""
    store(scratch, 0, s)
    for lane in range(WIDTH):
        rate, place = pieces[at * WIDTH + lane], scratch[lane]
        scratch[lane] = np.cos(rate * place) if rate > 0 else 0.0
        scratch[WIDTH + lane] = np.sin(rate * place) if rate > 0 else 0.0
    return load(scratch, 0), load(scratch, 1)


@part
def moved_axis(pieces, at, size, axes, axis, motion, waves):
    """Place, speed, acceleration and jerk of one axis on pieces, by Horner's rule."""
    s, v, a, j = motion
    cos, sin = waves
    place = first = second = third = spread(0.0)
    for k in range(at + 1 + 2 * axes + axis, at + size, axes):
        third = fma(third, s, second)
        second = fma(second, s, first)
        first = fma(first, s, place)
        place = fma(place, s, load(pieces, k))
    rate = load(pieces, at)
    cosine, sine = load(pieces, at + 1 + axis), load(pieces, at + 1 + axes + axis)
    along, slope = fma(cosine, cos, sine * sin), rate * (sine * cos - cosine * sin)
    place, first = place + along, first + slope
    bent = (spread(2.0) * second - rate * rate * along) * v
    third = spread(6.0) * third - rate * rate * slope
    jerk = fma(third * v * v, v, fma(spread(3.0) * bent, a, first * j))
    return place, first * v, fma(bent, v, first * a), jerk


@compiled
def _fill(rows, size, piece, axes, motion, values, row, scratch):
    """Write place, speed, acceleration and jerk of one axis after the other, each of all points."""
    blocks = piece.size // WIDTH
    for block in range(blocks):
        for lane in range(WIDTH):
            at = size * piece[block * WIDTH + lane]
            for k in range(size):
                row[k * WIDTH + lane] = rows[at + k]
        s, v = load(motion, block), load(motion, blocks + block)
        a, j = load(motion, 2 * blocks + block), load(motion, 3 * blocks + block)
        waves = wave(row, 0, s, scratch)
        for axis in range(axes):
            moved = moved_axis(row, 0, size, axes, axis, (s, v, a, j), waves)
            for k in range(4):
                store(values, (k * axes + axis) * blocks + block, moved[k])


def moved(
    pieces: Piece, piece: Int[np.ndarray, "..."], motion: Float[np.ndarray, "4 ..."]
) -> Float[np.ndarray, "4 ... m"]:
    """Place, speed, acceleration and jerk of the axes in a motion along some pieces.

    Args:
        pieces: of a path, (P,).
        piece: numbers of those that it is on.
        motion: its arc length since the beginning of each, speed, acceleration and jerk.
    """
    axes, count = pieces.cosine.shape[-1], piece.size
    if count == 0:
        return np.zeros((4, *piece.shape, axes))
    low, high = int(piece.min()), int(piece.max()) + 1  # of long paths few pieces at a time
    whole = -(-count // WIDTH) * WIDTH
    number, along = np.zeros(whole, int), np.zeros((4, whole))
    number[:count], along[:, :count] = np.ravel(piece) - low, motion.reshape(4, -1)
    rows, values = in_rows(pieces.taken(slice(low, high))), np.empty((4, axes, whole))
    size = rows.shape[1]
    row, scratch = np.empty(size * WIDTH), np.empty(2 * WIDTH)
    _fill(rows.ravel(), size, number, axes, along.ravel(), values.ravel(), row, scratch)
    return np.moveaxis(values[..., :count], 1, 2).reshape(4, *piece.shape, axes)


def jet(
    pieces: Piece, piece: Int[np.ndarray, "..."], s: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "4 ... m"]:
    """Place [m] and first, second and third derivative [1, 1/m, 1/m^2] of some pieces.

    Args:
        pieces: of a path, (P,).
        piece: numbers of those that are asked for.
        s: arc length since the beginning of each [m], of the same shape.
    """
    motion = np.zeros((4, *s.shape))
    motion[0], motion[1] = s, 1.0
    return moved(pieces, piece, motion)
