"""Derivatives of a path, and of a motion along it."""

import numpy as np
from jaxtyping import Float, Int

from jcontour.compiled import compiled
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import MotionSamples
from jcontour.native.lanes import part

Jet = tuple[np.ndarray, np.ndarray, np.ndarray]  # first, second and third derivative, axes last

SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]  # of a piece


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
    """Speed, acceleration and jerk of one axis on a piece, as `composed`, by Horner's rule."""
    place = first = second = third = 0.0
    for k in range(1 + 2 * axes + axis, row.size, axes):
        third = third * s + second
        second = second * s + first
        first = first * s + place
        place = place * s + row[k]
    rate, cosine, sine = row[0], row[1 + axis], row[1 + axes + axis]
    slope = rate * (sine * cos - cosine * sin)
    first, second = first + slope, 2.0 * second - rate * rate * (cosine * cos + sine * sin)
    third = 6.0 * third - rate * rate * slope
    bent = second * v
    return first * v, bent * v + first * a, third * v * v * v + 3.0 * bent * a + first * j


@compiled
def _fill_jets(rows: np.ndarray, piece: np.ndarray, motion: np.ndarray, jets: np.ndarray) -> None:
    axes = jets.shape[2]
    for i in range(piece.size):
        row, s = rows[piece[i]], motion[0, i]
        cos, sin = wave(row, s)
        for axis in range(axes):
            found = moved_axis(
                row, axes, axis, s, motion[1, i], motion[2, i], motion[3, i], cos, sin
            )
            jets[0, i, axis], jets[1, i, axis], jets[2, i, axis] = found


def path_derivatives(pieces: Piece, piece: Int[np.ndarray, "..."], s: np.ndarray) -> Jet:
    """First, second and third derivative [1, 1/m, 1/m^2] of some pieces at their own arc length.

    Args:
        pieces: of a path, (P,).
        piece: numbers of those that are asked for.
        s: arc length since the beginning of each [m], of the same shape.
    """
    return moved(
        pieces, piece, MotionSamples(s, np.ones_like(s), np.zeros_like(s), np.zeros_like(s))
    )


def moved(pieces: Piece, piece: Int[np.ndarray, "..."], motion: MotionSamples) -> Jet:
    """Speed, acceleration and jerk of the axes in a motion along some pieces, as `composed`.

    Args:
        pieces: of a path, (P,).
        piece: numbers of those that it is on.
        motion: its arc length since the beginning of each, and derivatives, all of one shape.
    """
    axes = pieces.cosine.shape[-1]
    flat = np.stack([np.ravel(values) for values in motion])
    jets = np.empty((3, flat.shape[1], axes))
    _fill_jets(in_rows(pieces), np.ravel(piece), flat, jets)
    first, second, third = jets.reshape(3, *piece.shape, axes)
    return first, second, third


def everywhere(pieces: Piece) -> Jet:
    """Derivatives at nine places of every piece, (9, P, m)."""
    s = SAMPLES * pieces.extent
    return path_derivatives(pieces, np.broadcast_to(np.arange(pieces.extent.size), s.shape), s)


def composed(path: Jet, motion: MotionSamples) -> Jet:
    """Derivatives of p(sigma(tau)) with respect to tau, axes last."""
    first, second, third = path
    v, a, j = (values[..., None] for values in motion[1:])
    return (
        first * v,
        second * v**2 + first * a,
        third * v**3 + 3 * second * v * a + first * j,
    )
