"""Loops that count how often they are looked at: a search may look without running the machine."""

from dataclasses import replace
from typing import Any

import equinox as eqx

from jcontour.controller import Controller
from jcontour.plant import Plant
from tuning.loops import Looked, Loops
from tuning.problem import Problem


class Tally:
    """A count on the host."""

    def __init__(self):
        """Begin at zero."""
        self.looks = 0


class CountedLoops(Loops):
    """Other loops, and a count of looks at them."""

    loops: Loops
    tally: Tally = eqx.field(static=True)

    def matrices(self, plants: Plant, controller: Controller) -> Any:
        """Those of the loops."""
        return self.loops.matrices(plants, controller)

    def look(self, matrices: Any, slopes: Any) -> tuple[Looked, Looked]:
        """What the loops show; counted."""
        self.tally.looks += 1
        return self.loops.look(matrices, slopes)


def with_counted_loops(problem: Problem) -> Problem:
    """The same problem, whose looks at its loops are counted."""
    if problem.loops is None:
        return problem
    return replace(problem, loops=CountedLoops(problem.loops, Tally()))


def looks_at(problem: Problem) -> int:
    """Number of looks at its loops so far; 0 for a problem without."""
    return problem.loops.tally.looks if isinstance(problem.loops, CountedLoops) else 0
