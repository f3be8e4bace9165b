"""Feeds and dwells of moves in the digits of a program, by whose clock they keep to their times.

Every feed is rounded. What a move is late by, the next one makes up for: no drift is left.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.geometry.toolpath_rules import SLOWEST

LEAST_FEED = 6e4 * SLOWEST  # [mm/min]
EARLY = 1e-3  # of the time of a move: more of it, and the tool waits behind it


class Step(NamedTuple):
    """A line of the program.

    Attributes:
        end: number of the end that a move leads to; None of a dwell.
        word: F of a move [mm/min], P of a dwell [s].
    """

    end: int | None
    word: float


def steps(places: Float[np.ndarray, "M m"], lasting: Float[np.ndarray, " moves"]) -> list[Step]:
    """Moves from place to place in their times, dwells where they stay.

    >>> steps(np.array([[0.0], [1.0], [1.0]]), np.array([0.1, 0.5]))
    [Step(end=1, word=600.0), Step(end=None, word=0.5)]

    Args:
        places: as the program has them [mm].
        lasting: time of every move [s].
    """
    found, late, rest = [], 0.0, 0.0  # late: of the program's clock
    for end, (way, time) in enumerate(zip(_lengths(places), lasting, strict=True), start=1):
        if way == 0:
            rest += float(time)
            continue
        if rest:
            found.append(_dwell(rest - late))
            late += found[-1].word - rest
            rest = 0.0
        found.append(Step(end, max(_digits(60 * way / (time - late)), LEAST_FEED)))
        late += 60 * way / found[-1].word - float(time)
        if late < -EARLY * time:  # its feed would be too slow for a program
            late, rest = 0.0, -late
    return [*found, _dwell(rest - late)] if rest else found


def clock(
    places: Float[np.ndarray, "M m"], written: list[Step]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n m"]]:
    """Times [s] at which the program is at places [mm], between which it goes evenly."""
    at, times = [0], [0.0]
    for step in written:
        if step.end is None:
            times.append(times[-1] + step.word)
        else:
            way = float(np.linalg.norm(places[step.end] - places[at[-1]]))
            times.append(times[-1] + 60 * way / step.word)
        at.append(at[-1] if step.end is None else step.end)
    return np.array(times), places[at]


def _lengths(places: Float[np.ndarray, "M m"]) -> Float[np.ndarray, " moves"]:
    """Lengths from place to place."""
    return np.linalg.norm(np.diff(places, axis=0), axis=1)


def _digits(number: float) -> float:
    """A feed in the digits that the program has."""
    return float(f"{number:.6g}")


def _dwell(lasting: float) -> Step:
    return Step(None, float(f"{lasting:.9g}"))
