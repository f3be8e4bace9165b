"""Best values so far, and what a table says of them."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.benchmarks.searches import tuners
from experiments.benchmarks.searches.search_methods import METHODS
from experiments.benchmarks.searches.tuner_problems import with_counted_loops
from experiments.benchmarks.searches.tuners import Cost, TunersBench, measured
from experiments.tables import show
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import console_of
from tuning.history import Evaluated
from tuning.loops import Looked, Loops
from tuning.objectives import AtMost
from tuning.parameters import Positive


def trace(method, values, each=1):
    counts = each * np.arange(1.0, len(values) + 1)
    return tuners._better("p", method, 0, values, counts)


def test_a_trace_holds_the_best_so_far():
    one = trace("grid", [np.inf, 5.0, 7.0, 2.0, 2.0])
    assert (one.spent, one.best) == ([2.0, 4.0], [5.0, 2.0])
    assert trace("grid", [np.inf]).least == trace("grid", []).least == np.inf


def test_searches_are_compared_with_the_best_of_all():
    traces = [
        *(trace("jcontour", values, each=3) for values in ([4.0, 2.0], [2.02])),
        *(trace("Sobol", values) for values in ([9.0, 8.0, 2.03], [7.0, 6.0])),
    ]
    (ours, theirs), curves = tuners._summed_up(2, traces, 10)
    assert (ours.best, ours.reached, ours.evaluations) == (2.0, 2, (3.0, 3.0, 6.0))
    assert (theirs.reached, theirs.evaluations) == (1, (3.0, 3.0, None))
    assert curves["jcontour"].low[2] == pytest.approx(1.01)


def test_nobody_arrives_where_nothing_is_within_the_limits():
    (row,), curves = tuners._summed_up(2, [trace("Sobol", [np.inf, np.inf])], 10)
    assert (row.reached, row.evaluations, curves) == (0, (None, None, None), {})


@pytest.fixture
def small(monkeypatch, proportional_problem):
    """Two gains on a circle, the only problem."""
    problem = proportional_problem(AtMost(rms_increment=2e-5, rms_tracking_error=5e-4))
    start = {"x": jnp.asarray(0.3), "y": jnp.asarray(0.3)}
    monkeypatch.setattr(tuners, "PROBLEMS", ("gains",))
    monkeypatch.setattr(tuners, "problem_of", lambda name: (problem, start))


@pytest.mark.slow
def test_a_run_goes_on_from_its_file(small, tmp_path):
    flags = Bench(what="tuners", seeds=1, evaluations=60, keep=tmp_path / "kept.json")
    told = []
    first = measured(flags, told.append)
    assert told == [f"start 1 of 1: gains: {name}" for name in ("jcontour", *METHODS)]
    assert {row.method for row in first.rows} == {"jcontour", *METHODS}
    assert all(row.weights == 2 and row.seeds == 1 for row in first.rows)
    ours = first.rows[0]
    assert ours.method == "jcontour" and ours.reached == 1
    (needed,) = set(ours.evaluations)
    assert needed % 3 == 0 and needed <= 60
    assert measured(flags, told.append).rows == first.rows and len(told) == 1 + len(METHODS)
    more = measured(replace(flags, seeds=2, searches=("Sobol",)), told.append)
    assert told[1 + len(METHODS) :] == ["start 2 of 2: gains: Sobol"]
    assert {row.method: row.seeds for row in more.rows} == {"Sobol": 2}


def test_looks_without_a_run_count_too(monkeypatch):
    """A start that is stabilised looks at its loops before the machine runs."""

    def advance(problem, weights, effort, state):
        for _ in range(3 if not state.history else 1):
            problem.loops.look(np.zeros(()), np.zeros(()))
        row = Evaluated(0, np.zeros(1), 5.0 - len(state.history), -1.0, None, False)
        return replace(state, history=[*state.history, row])

    monkeypatch.setattr(tuners, "advance", advance)
    space, start = {"x": Positive()}, {"x": 1.0}
    problem = with_counted_loops(Posed(Silent(), space))
    found = tuners._ours(problem, start, np.zeros(1), 0, 16)
    assert found == ([5.0, 4.0, 3.0], [9.0, 12.0, 15.0])


def test_scattered_points_without_slopes_count_once(monkeypatch):
    def advance(problem, weights, effort, state):
        start = -1 if state.history else 0
        row = Evaluated(start, np.zeros(1), 5.0 - len(state.history), -1.0, None, False)
        return replace(state, history=[*state.history, row])

    monkeypatch.setattr(tuners, "advance", advance)
    problem = Posed(None, {"x": Positive()})
    found = tuners._ours(problem, {"x": jnp.asarray(1.0)}, np.zeros(1), 0, 6)
    assert found == ([5.0, 4.0, 3.0, 2.0], [3.0, 4.0, 5.0, 6.0])


class Silent(Loops):
    """Loops that show nothing."""

    def matrices(self, plants, controller):
        return controller

    def look(self, matrices, slopes):
        return Looked(), Looked()


@dataclass(frozen=True)
class Posed:
    """A problem as far as its loops and its space."""

    loops: Loops | None
    space: dict


def test_the_table_says_who_arrives(capsys):
    traces = [trace("jcontour", [2.0], each=3), trace("Sobol", [9.0])]
    rows, _ = tuners._summed_up(2, traces, 10)
    costs = [Cost("p", (1.5, 4.0), (0.002, 0.0075))]
    show(console_of(), tuners.tables(TunersBench(10, rows, costs)))
    printed = capsys.readouterr().out
    words = printed.split()
    assert "jcontour" in words and "Sobol" in words
    assert "1 of 1" in printed and "0 of 1" in printed and "3 to 3" in printed
    assert "7.5" in printed and "1.5" in printed


def test_missing_libraries_are_named_with_what_installs_them(monkeypatch):
    monkeypatch.setattr(tuners, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="uv run --group bench jcontour bench tuners"):
        measured(Bench(what="tuners"), print)


def test_unknown_searches_are_named():
    with pytest.raises(ValueError, match="searches: needs names of jcontour, .*, received TPS"):
        measured(Bench(what="tuners", searches=("TPS",)), print)
