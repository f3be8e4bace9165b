"""Canned cycles of drilling and boring (G73, G74, G81 to G86, G88, G89), step by step.

The steps are those of LinuxCNC: above the hole at the level of before, at traverse down to R, then
into it. G74, G82, G84, G86, G88 and G89 dwell at the bottom for P seconds, where P is given. Stops
and turns of the spindle move nothing; after G88, where an operator takes the tool out, it goes out
at traverse.
"""

from collections.abc import Iterator
from typing import NamedTuple

from jcontour.geometry.toolpath_rules import INCH, ToolpathError

PECK_CLEARANCE = 0.01 * INCH  # [m] above the bottom of before, where feeding begins again
MOST_PECKS = 10_000  # of a hole
DWELLING = frozenset({740, 820, 840, 860, 880, 890})  # at the bottom


class Hole(NamedTuple):
    """Levels of a hole along the normal of the plane [m].

    Attributes:
        retract: R, where feeding begins.
        bottom: where it ends.
        clear: level after it.
        peck: depth at a time, None where it is fed at once.
        dwell: at the bottom, in cycles that dwell [s].
    """

    retract: float
    bottom: float
    clear: float
    peck: float | None
    dwell: float = 0.0


class Step(NamedTuple):
    """A move along the normal of the plane to a level [m], and how long it rests there [s]."""

    level: float
    rapid: bool
    dwell: float = 0.0


def hole_at(
    lengths: dict[str, float], axis: str, before: float, incremental: bool, to_r_plane: bool
) -> Hole:
    """Hole of lengths [m] by letter: the bottom on the axis, R and, for pecks, Q; P is a time [s].

    Incremental, R counts from the level `before` the cycles [m] and the bottom from R.

    Raises:
        ToolpathError: a letter is missing, or R lies below the bottom.
    """
    for letter in (axis, "R"):
        if letter not in lengths:
            raise ToolpathError(f"a canned cycle needs {letter}")
    retract = lengths["R"] + (before if incremental else 0.0)
    bottom = lengths[axis] + (retract if incremental else 0.0)
    if retract < bottom:
        raise ToolpathError("R of a canned cycle lies below the bottom of the hole")
    clear = retract if to_r_plane else max(before, retract)
    return Hole(retract, bottom, clear, lengths.get("Q"), lengths.get("P", 0.0))


def steps(code: int, hole: Hole) -> Iterator[Step]:
    """Steps into and out of a hole, from its level R.

    >>> hole = Hole(retract=2e-3, bottom=-5e-3, clear=2e-3, peck=None)
    >>> [(step.level, step.rapid) for step in steps(810, hole)]
    [(-0.005, False), (0.002, True)]

    Args:
        code: of the cycle, in tenths.
        hole: its levels.

    Raises:
        ToolpathError: a peck that is not above zero, or thousands of them.
    """
    if code in (730, 830):
        yield from _pecks(code, hole)
    yield Step(hole.bottom, rapid=False, dwell=hole.dwell if code in DWELLING else 0.0)
    if code == 850:
        yield Step(hole.retract, rapid=False)
    yield Step(hole.clear, rapid=code not in (740, 840, 890))


def _pecks(code: int, hole: Hole) -> Iterator[Step]:
    peck = hole.peck
    if peck is None or not peck > 0:
        raise ToolpathError(f"G{code // 10} needs a depth Q above 0")
    if (hole.retract - hole.bottom) / peck > MOST_PECKS:
        raise ToolpathError(f"G{code // 10}: more than {MOST_PECKS} pecks in a hole")
    depth = hole.retract - peck
    while depth > hole.bottom:
        yield Step(depth, rapid=False)
        if code == 830:
            yield Step(hole.retract, rapid=True)
        yield Step(depth + PECK_CLEARANCE, rapid=True)
        depth -= peck
