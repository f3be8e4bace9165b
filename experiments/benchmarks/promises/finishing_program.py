"""A finishing program as CAM systems write them: passes along a wall, in chords of a curve.

The wall has six corners, and between them sides that are bowed by three sines:

    side(t) = P + t (Q - P) + n |Q - P| sum_k a_k sin(k pi t),    0 <= t <= 1

from corner P to corner Q, n across. A pass follows the wall; the next one is a little smaller, and
follows it at once. Where the passes get small they begin anew, as on the next level of depth.
Chords are as long as keeps them near the curve,

    length^2 = 8 CHORD / curvature,

within LEAST and MOST. Corners and bows come from a seed: the program is the same every time.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

SEED = 15
CORNERS = 6
RADIUS = 5e-3  # [m] of the wall, about
BOWS = np.array([0.12, 0.05, 0.02])  # of a side's length, at most
STEP = 0.99  # of the size, from pass to pass
SMALLEST = 0.4  # of the size: a pass that is smaller is the last of its level
CHORD = 0.1e-6  # [m] of the chords from the curve
LEAST, MOST = 0.01e-3, 0.5e-3  # [m] of a chord
FINE = 4001  # points of a side that its chords are laid by
FEED = 3000  # [mm/min]
WAVES = np.pi * np.arange(1, BOWS.size + 1)


class Side(NamedTuple):
    """One side of one pass.

    Attributes:
        first: corner where it begins [m].
        last: corner where it ends [m].
        bow: of its sines, as shares of its length.
    """

    first: Float[np.ndarray, " 2"]
    last: Float[np.ndarray, " 2"]
    bow: Float[np.ndarray, " 3"]

    def at(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Points of the curve [m]."""
        along = self.last - self.first
        across = np.array([-along[1], along[0]])
        height = np.sin(np.outer(t, WAVES)) @ self.bow
        return self.first + np.outer(t, along) + np.outer(height, across)

    def chords(self) -> Float[np.ndarray, " n"]:
        """Parameters t of the ends of its chords."""
        t = np.linspace(0.0, 1.0, FINE)
        size = np.linalg.norm(self.last - self.first)
        slope = np.cos(np.outer(t, WAVES)) @ (WAVES * self.bow)
        bend = np.sin(np.outer(t, WAVES)) @ (WAVES**2 * self.bow)
        curvature = np.abs(bend) / (size * (1 + slope**2) ** 1.5)
        length = np.sqrt(8 * CHORD / np.maximum(curvature, 8 * CHORD / MOST**2))
        density = size * np.hypot(1.0, slope) / np.maximum(length, LEAST)
        passed = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(t)))
        return np.interp(np.linspace(0.0, passed[-1], int(np.ceil(passed[-1])) + 1), passed, t)


def finishing_sides(chords: int) -> list[Side]:
    """Sides of as many passes as take so many chords; the last one may take a few more."""
    sides, count = [], 0
    for side in _passes():
        sides.append(side)
        count += side.chords().size - 1
        if count >= chords:
            return sides
    return sides


def _passes() -> Iterator[Side]:
    """Sides one after the other, without an end; each begins where the one before ends."""
    random = np.random.default_rng(SEED)
    angle = 2 * np.pi * (np.arange(CORNERS) + random.uniform(-0.25, 0.25, CORNERS)) / CORNERS
    radius = RADIUS * random.uniform(0.8, 1.2, CORNERS)
    corner = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    bow = BOWS * random.uniform(-1.0, 1.0, (CORNERS, BOWS.size))
    size, place = 1.0, corner[0]
    while True:
        for k in range(CORNERS):
            inwards = STEP if k == CORNERS - 1 else 1.0
            there = size * inwards * corner[(k + 1) % CORNERS]
            yield Side(place, there, bow[k])
            place = there
        size *= STEP
        if size < SMALLEST:
            yield Side(place, corner[0], 0.0 * bow[0])
            size, place = 1.0, corner[0]


def gcode(sides: list[Side], decimals: int) -> str:
    """Program of the sides' chords, in millimetres with so many decimals."""
    points = np.concatenate([sides[0].at(np.zeros(1)), *(s.at(s.chords())[1:] for s in sides)])
    words = [f"X{x:.{decimals}f} Y{y:.{decimals}f}" for x, y in 1e3 * points]
    return "\n".join(["G21 G90 G17 G94", f"G0 {words[0]}", f"G1 F{FEED}", *words[1:], "M2", ""])
