"""Looks at loops are counted, and show what they showed before."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.benchmarks.searches.counted_loops import CountedLoops, looks_at, with_counted_loops
from tuning.loops import Loops


class Doubled(Loops):
    """Loops that show twice what they are given."""

    def matrices(self, plants, controller):
        return controller + plants

    def look(self, matrices, slopes):
        return 2 * matrices, 2 * slopes


@dataclass(frozen=True)
class Posed:
    """A problem as far as its loops."""

    loops: Loops | None = None


def test_every_look_counts():
    problem = with_counted_loops(Posed(Doubled()))
    assert isinstance(problem.loops, CountedLoops) and looks_at(problem) == 0
    assert problem.loops.matrices(1, 2) == 3
    assert problem.loops.look(np.array(3.0), np.array(4.0)) == (6.0, 8.0)
    problem.loops.look(np.array(3.0), np.array(4.0))
    assert looks_at(problem) == 2 and looks_at(with_counted_loops(Posed(Doubled()))) == 0
    assert looks_at(replace(problem)) == 2  # of the same loops


def test_a_problem_without_loops_stays_as_it_is():
    problem = Posed()
    assert with_counted_loops(problem) is problem and looks_at(problem) == 0
