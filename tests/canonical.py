"""Machines, contours and references of one shape, so that tests share their compiled programs.

A program is compiled for the shapes of what it is given: matrices, steps, pieces of a contour,
members of a family. A compiled program runs in a millisecond, compiling it takes a second. Tests
of what a thing does take the shapes of this file. A test that is about shapes makes its own.
"""

from functools import cache

import numpy as np

from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import circle, line, polygon, polyline, stack
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference, along
from jcontour.plant import Plant
from jcontour.simulation.evaluation import member, stack_plants

DT = 1e-3  # [s]
STEPS = 16
PREVIEW = 4
PIECES = 8
MEMBERS = 2  # of a family
FEED = 25e-3  # [m/s]
RADIUS = 1e-3  # [m] of the circle

# poles of the two lags of each axis behind its integrator, and the gain of each
LAGS = ((0.85, 0.3), (0.8, 0.4), (0.75, 0.2))
GAINS = (1.0, 1.1, 0.9)


def _axis(slow: float, fast: float, gain: float) -> tuple[np.ndarray, np.ndarray]:
    """A drive that takes a speed [m/s]: position, speed behind two lags, and its last command."""
    A = np.array(
        [
            [1.0, DT, 0.0, 0.0],
            [0.0, slow, 1.0 - slow, 0.0],
            [0.0, 0.0, fast, 1.0 - fast],
            [0.0, 0.0, 0.0, 0.0],
        ]
    )
    return A, np.array([0.0, 0.0, 0.0, gain])


@cache
def plant(axes: int, gain: float = 1.0) -> LinearPlant:
    """Independent axes of four states each that take a speed; the last one is a sample of delay."""
    A, B, C = np.zeros((4 * axes, 4 * axes)), np.zeros((4 * axes, axes)), np.zeros((axes, 4 * axes))
    for i in range(axes):
        own = slice(4 * i, 4 * i + 4)
        A[own, own], B[own, i] = _axis(*LAGS[i], gain * GAINS[i])
        C[i, 4 * i] = 1.0
    return LinearPlant(A, B, C, DT)


@cache
def family(axes: int) -> Plant:
    """The plant, and the same with a tenth more gain: a stack of two."""
    return stack_plants([plant(axes), plant(axes, 1.1)])


def padded(contour: Contour) -> Contour:
    """The contour with as many pieces, and as many kinds of them, as every other one here."""
    zigzag = polyline(np.outer(np.arange(PIECES + 1.0), np.eye(contour.axes)[0]))
    others = [zigzag] if contour.axes == 1 else [zigzag, round_path(contour.axes)]
    return member(stack([contour, *others]), 0)


def round_path(axes: int) -> Contour:
    """A circle in the plane of the first two axes; a line on one axis."""
    return line([0.0], [1e-2]) if axes == 1 else circle(RADIUS, np.zeros(axes))


def square() -> Contour:
    """A square of four pieces, its corners seen in the steps."""
    side = 6 * FEED * DT
    return polygon([(0, 0), (side, 0), (side, side), (0, side)])


def reference(contour: Contour, steps: int = STEPS, preview: int = PREVIEW) -> Reference:
    """A constant feed along the contour, entered and left in motion."""
    return along(padded(contour), FEED * DT * np.arange(steps), DT, preview, at_rest=False)
