"""What a search without slopes sees of a problem is what the tuner sees."""

from dataclasses import dataclass

import numpy as np
import pytest

from experiments.benchmarks.searches.tuner_problems import (
    LOST,
    PROBLEMS,
    _departed,
    looks_at,
    measure_of,
    problem_of,
    with_counted_loops,
)
from tuning.loops import Loops
from tuning.parameters import Chart
from tuning.point import evaluate_point


@pytest.mark.slow
def test_values_are_those_of_the_tuner():
    problem, start = problem_of("square, increment limited")
    z = np.asarray(Chart(problem.space, start).coordinates())
    measure, seen = measure_of(problem, start), []
    for away in (0.0, 0.5):
        point, tried = evaluate_point(problem, start, z + away), measure(z + away)
        excess = max(0.0, float(point.limits.max()))
        seen.append(excess)
        assert tried.merit == pytest.approx(np.log(point.objective) + 10 * excess, rel=1e-9)
        assert tried.objective == (np.inf if excess > 1e-6 else pytest.approx(point.objective))
    assert measure(z + 1000.0 * np.sign(z)).merit >= LOST  # nothing is finite there


def test_points_that_diverge_are_worse_the_farther_they_leave_their_contour():
    assert [_departed(np.array(one)) for one in ([-3.0, 2.0], [-3.0, -1.0])] == [2.0, 0.0]
    assert _departed(np.array([np.inf, 2.0])) == _departed(np.array([np.nan])) == LOST


def test_there_are_six_problems_of_2_to_14_weights():
    assert len(PROBLEMS) == 6


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


def test_every_look_counts_and_shows_the_same():
    problem = with_counted_loops(Posed(Doubled()))
    assert looks_at(problem) == 0 and problem.loops.matrices(1, 2) == 3
    for _ in range(2):
        assert problem.loops.look(np.array(3.0), np.array(4.0)) == (6.0, 8.0)
    assert looks_at(problem) == 2 and looks_at(with_counted_loops(Posed(Doubled()))) == 0
    assert looks_at(with_counted_loops(Posed())) == 0
