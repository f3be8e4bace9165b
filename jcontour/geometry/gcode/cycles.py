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


class Step(NamedTuple):
    """A move along the normal of the plane to a level [m], and how long it rests there [s]."""

    level: float
    rapid: bool
    dwell: float = 0.0


def steps(code: int, retract: float, clear: float, lengths: dict[str, float]) -> Iterator[Step]:
    """Steps into and out of a hole, from the level `retract` of R.

    >>> [step[:2] for step in steps(810, 2e-3, 2e-3, {"bottom": -5e-3})]
    [(-0.005, False), (0.002, True)]

    Args:
        code: of the cycle, in tenths.
        retract: level where feeding begins [m].
        clear: level after the hole [m].
        lengths: level of its `bottom` and, for pecks, depth Q at a time [m]; P is a time [s].

    Raises:
        ToolpathError: a peck that is not above zero, or thousands of them.
    """
    bottom, peck = lengths["bottom"], lengths.get("Q", 0.0)
    if code in (730, 830):
        if not peck > 0:
            raise ToolpathError(f"G{code // 10} needs a depth Q above 0")
        if (retract - bottom) / peck > MOST_PECKS:
            raise ToolpathError(f"G{code // 10}: more than {MOST_PECKS} pecks in a hole")
        depth = retract - peck
        while depth > bottom:
            yield Step(depth, rapid=False)
            if code == 830:
                yield Step(retract, rapid=True)
            yield Step(depth + PECK_CLEARANCE, rapid=True)
            depth -= peck
    yield Step(bottom, rapid=False, dwell=lengths.get("P", 0.0) if code in DWELLING else 0.0)
    if code == 850:
        yield Step(retract, rapid=False)
    yield Step(clear, rapid=code not in (740, 840, 890))
