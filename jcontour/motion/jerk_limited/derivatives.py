"""Derivatives of a path, and of a motion along it: for arrays of places, and in compiled loops."""

import numpy as np
from jaxtyping import Int

from jcontour.compiled import compiled
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import MotionSamples
from jcontour.native.lanes import part

Jet = tuple[np.ndarray, np.ndarray, np.ndarray]  # first, second and third derivative, axes last

SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]  # of a piece


@part
def wave(pieces, k, s):
    """Cosine and sine of a piece's waves at its own arc length [m]."""
    rate = pieces.rate[k]
    return (np.cos(rate * s), np.sin(rate * s)) if rate > 0 else (1.0, 0.0)


@part
def axis_jet(pieces, k, axis, s, cos, sin):
    """First, second and third derivative of one axis on piece k, by Horner's rule."""
    place = first = second = third = 0.0
    for i in range(pieces.polynomial.shape[1] - 1, -1, -1):
        third = third * s + second
        second = second * s + first
        first = first * s + place
        place = place * s + pieces.polynomial[k, i, axis]
    rate, cosine, sine = pieces.rate[k], pieces.cosine[k, axis], pieces.sine[k, axis]
    slope = rate * (sine * cos - cosine * sin)
    bend = rate * rate * (cosine * cos + sine * sin)
    return first + slope, 2.0 * second - bend, 6.0 * third - rate * rate * slope


@compiled
def _fill_jets(pieces: Piece, piece: np.ndarray, s: np.ndarray, jets: np.ndarray) -> None:
    for i in range(s.size):
        cos, sin = wave(pieces, piece[i], s[i])
        for axis in range(jets.shape[2]):
            first, second, third = axis_jet(pieces, piece[i], axis, s[i], cos, sin)
            jets[0, i, axis], jets[1, i, axis], jets[2, i, axis] = first, second, third


def path_derivatives(pieces: Piece, piece: Int[np.ndarray, "..."], s: np.ndarray) -> Jet:
    """First, second and third derivative [1, 1/m, 1/m^2] of some pieces at their own arc length.

    Args:
        pieces: of a path, (P,).
        piece: numbers of those that are asked for.
        s: arc length since the beginning of each [m], of the same shape.
    """
    axes = pieces.cosine.shape[-1]
    jets = np.empty((3, s.size, axes))
    _fill_jets(pieces, np.ravel(piece), np.ravel(s), jets)
    first, second, third = jets.reshape(3, *s.shape, axes)
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


@part
def chained(first, second, third, v, a, j):
    """Speed, acceleration and jerk of `composed`, of one axis at one time."""
    return (
        first * v,
        second * v * v + first * a,
        third * v * v * v + 3.0 * second * v * a + first * j,
    )


@part
def moved(old, cells, i, elapsed):
    """Place on the piece [m], speed, acceleration and jerk of the old motion within cell i."""
    t = cells.elapsed[i] + elapsed
    cubic = old.coefficients[cells.cell[i]]
    s, v, a, j = cubic[0], cubic[1], cubic[2], cubic[3]
    place = s + t * (v + t * (a + t * j)) - cells.place[i]
    return place, v + t * (2 * a + 3 * t * j), 2 * a + 6 * t * j, 6 * j
