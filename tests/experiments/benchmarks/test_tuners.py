"""Best values so far, and what a table says of them."""

from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.benchmarks import tuners
from experiments.benchmarks.counted_loops import with_counted_loops
from experiments.benchmarks.search_methods import METHODS
from experiments.benchmarks.search_traces import ProblemTraces, Trace
from experiments.benchmarks.tuners import Cost, TunersBench, measured, show
from experiments.options import Bench
from experiments.reports.tables import console_of
from jcontour.controller import Controller
from jcontour.geometry.contours import circle
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_plants, stack_references
from tuning.history import Evaluated
from tuning.loops import Looked, Loops
from tuning.objectives import AtMost, mean_contour_error
from tuning.parameters import Positive
from tuning.problem import Problem


def trace(values, each=1):
    counts = each * np.arange(1.0, len(values) + 1)
    return Trace.of(values, counts, counts)


def of_two(traces, known=np.inf):
    return ProblemTraces(2, known, (0.0, 0.0), (0.0, 0.0), traces)


def test_searches_are_compared_with_the_best_of_all():
    traces = {
        "jcontour": [trace([4.0, 2.0], each=3), trace([2.02], each=3)],
        "Sobol": [trace([9.0, 8.0, 2.03]), trace([7.0, 6.0])],
    }
    (ours, theirs), curves = tuners._summed_up("p", of_two(traces), 10)
    assert (ours.best, ours.reached, ours.evaluations) == (2.0, 2, (3.0, 3.0, 6.0))
    assert (theirs.reached, theirs.evaluations) == (1, (3.0, 3.0, None))
    assert isinstance(curves["Sobol"].middle, np.ndarray)
    assert curves["jcontour"].low[2] == pytest.approx(1.01)
    (ours, _), _ = tuners._summed_up("p", of_two(traces, 1.99), 10)
    assert (ours.best, ours.reached) == (1.99, 2)  # what a search from elsewhere found counts


def test_nobody_arrives_where_nothing_is_within_the_limits():
    (row,), curves = tuners._summed_up("p", of_two({"Sobol": [trace([np.inf, np.inf])]}), 10)
    assert (row.reached, row.evaluations, curves) == (0, (None, None, None), {})


class Proportional(Controller):
    """u = gains (y_d - x) for integrators."""

    gains: jax.Array
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return None, self.gains * (plan - measurement)


@pytest.fixture
def small(monkeypatch):
    """Two gains on a circle, the only problem."""
    plant = LinearPlant(np.eye(2), np.diag([1.0, 0.7]), np.eye(2), 1e-3)
    reference = along(circle(1e-3), 1e-4 * np.arange(20), 1e-3, 0, at_rest=False)
    start = {"x": jnp.asarray(0.3), "y": jnp.asarray(0.3)}
    problem = Problem(
        lambda weights: Proportional(jnp.stack([weights["x"], weights["y"]])),
        stack_plants([plant]),
        stack_references([reference]),
        mean_contour_error,
        {"x": Positive(), "y": Positive()},
        AtMost(rms_increment=2e-5, rms_tracking_error=5e-4),
    )
    monkeypatch.setattr(tuners, "PROBLEMS", ("gains",))
    monkeypatch.setattr(tuners, "problem_of", lambda name: (problem, start))


@pytest.mark.slow
def test_a_run_goes_on_from_its_file(small, tmp_path):
    flags = Bench(what="tuners", seeds=1, evaluations=60, keep=tmp_path / "kept.json")
    told = []
    first = measured(flags, told.append)
    assert told == ["gains: start 1 of 1"]
    assert {row.method for row in first.rows} == {"jcontour", *METHODS}
    assert all(row.weights == 2 and row.seeds == 1 for row in first.rows)
    ours = first.rows[0]
    assert ours.method == "jcontour" and ours.reached == 1
    (needed,) = set(ours.evaluations)
    assert needed % 3 == 0 and needed <= 60
    assert measured(flags, told.append) == first and len(told) == 1
    both = measured(replace(flags, seeds=2), told.append)
    assert told[1:] == ["gains: start 2 of 2"] and both.rows[0].seeds == 2


def test_looks_without_a_run_count_too(monkeypatch):
    """A start that is stabilised looks at its loops before the machine runs."""

    def advance(problem, weights, effort, state):
        for _ in range(3 if not state.history else 1):
            problem.loops.look(np.zeros(()), np.zeros(()))
        row = Evaluated(0, np.zeros(1), 5.0 - len(state.history), -1.0, None, False)
        return replace(state, history=[*state.history, row])

    monkeypatch.setattr(tuners, "advance", advance)
    space, start = {"x": Positive()}, {"x": jnp.asarray(1.0)}
    problem = with_counted_loops(Posed(Silent(), space))
    found = tuners._ours(problem, start, np.zeros(1), 0, 16, 0.0)
    assert (found.spent, found.best) == ([9.0, 12.0, 15.0], [5.0, 4.0, 3.0])


class Silent(Loops):
    """Loops that show nothing."""

    def matrices(self, controller, plants):
        return controller

    def look(self, matrices, slopes):
        return Looked(), Looked()


@dataclass(frozen=True)
class Posed:
    """A problem as far as its loops and its space."""

    loops: Loops
    space: dict


def test_the_table_says_who_arrives(capsys):
    traces = {"jcontour": [trace([2.0], each=3)], "Sobol": [trace([9.0])]}
    rows, _ = tuners._summed_up("p", of_two(traces), 10)
    costs = [Cost("p", (1.5, 4.0), (0.002, 0.0075))]
    show(console_of(), TunersBench(10, rows, costs))
    printed = capsys.readouterr().out
    assert "1 of 1" in printed and "0 of 1" in printed and "3 to 3" in printed
    assert "7.5" in printed and "1.5" in printed


def test_missing_libraries_are_named_with_what_installs_them(monkeypatch):
    monkeypatch.setattr(tuners, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="uv run --group bench jcontour bench tuners"):
        measured(Bench(what="tuners"), print)


@pytest.mark.parametrize("flag", ["seeds", "evaluations"])
def test_numbers_below_one_are_named(flag):
    with pytest.raises(ValueError, match=f"{flag}: needs at least 1, received 0"):
        measured(Bench(what="tuners", **{flag: 0}), print)
