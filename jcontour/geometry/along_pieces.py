"""Place, speed, acceleration and jerk of the axes along pieces, in NumPy arrays, by compiled loops.

With p(s) a piece and s(t) the motion along it:

    place          p(s)
    speed          p' v
    acceleration   p'' v^2 + p' a
    jerk           p''' v^3 + 3 p'' v a + p' j

At v = 1 and a = j = 0 they are the derivatives of the piece.
"""

import numpy as np
from jaxtyping import Float, Int

from jcontour.compiled import compiled
from jcontour.geometry.pieces import Piece
from jcontour.native.lanes import part

Jet = tuple[np.ndarray, np.ndarray, np.ndarray]  # first, second and third derivative, axes last


def in_rows(pieces: Piece) -> Float[np.ndarray, "P numbers"]:
    """A row for every piece: its rate, cosines and sines, and the polynomials, highest power first.

    One array is compiled sooner than four.
    """
    falling = pieces.polynomial[:, ::-1].reshape(len(pieces.rate), -1)
    return np.concatenate([pieces.rate[:, None], pieces.cosine, pieces.sine, falling], axis=1)


@part
def wave(row, s):
    """Cosine and sine of a piece's waves at its own arc length [m]."""
    return (np.cos(row[0] * s), np.sin(row[0] * s)) if row[0] > 0 else (1.0, 0.0)


@part
def moved_axis(row, axes, axis, s, v, a, j, cos, sin):
    """Place, speed, acceleration and jerk of one axis on a piece, by Horner's rule."""
    place = first = second = third = 0.0
    for k in range(1 + 2 * axes + axis, row.size, axes):
        third = third * s + second
        second = second * s + first
        first = first * s + place
        place = place * s + row[k]
    rate, cosine, sine = row[0], row[1 + axis], row[1 + axes + axis]
    along, slope = cosine * cos + sine * sin, rate * (sine * cos - cosine * sin)
    place, first = place + (along if rate > 0 else 0.0), first + slope
    second, third = 2.0 * second - rate * rate * along, 6.0 * third - rate * rate * slope
    bent = second * v
    return place, first * v, bent * v + first * a, third * v * v * v + 3.0 * bent * a + first * j


@compiled
def _fill(rows: np.ndarray, piece: np.ndarray, motion: np.ndarray, found: np.ndarray) -> None:
    axes = found.shape[2]
    for i in range(piece.size):
        row, s, v, a, j = rows[piece[i]], motion[0, i], motion[1, i], motion[2, i], motion[3, i]
        cos, sin = wave(row, s)
        for axis in range(axes):
            of_axis = moved_axis(row, axes, axis, s, v, a, j, cos, sin)
            for k in range(4):
                found[k, i, axis] = of_axis[k]


def moved(
    pieces: Piece, piece: Int[np.ndarray, "..."], motion: Float[np.ndarray, "4 ..."]
) -> Float[np.ndarray, "4 ... m"]:
    """Place, speed, acceleration and jerk of the axes in a motion along some pieces.

    Args:
        pieces: of a path, (P,).
        piece: numbers of those that it is on.
        motion: its arc length since the beginning of each, speed, acceleration and jerk.
    """
    axes = pieces.cosine.shape[-1]
    found = np.empty((4, piece.size, axes))
    _fill(in_rows(pieces), np.ravel(piece), motion.reshape(4, -1), found)
    return found.reshape(4, *piece.shape, axes)


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
