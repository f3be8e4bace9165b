"""Best values so far, and what a table says of them."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.benchmarks import tuners
from experiments.benchmarks.search_methods import METHODS, Spent
from experiments.benchmarks.tuners import (
    LOST,
    PROBLEMS,
    measure_of,
    measured,
)
from experiments.tables import show
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import console_of
from jcontour.app.runs.tuning.problem import tuning_run
from tuning.objectives import AtMost
from tuning.parameters import Chart, Positive
from tuning.point import Evaluated, evaluate_point


def trace(method, values, each=1):
    counts = each * np.arange(1.0, len(values) + 1)
    return tuners._better("p", method, 0, values, counts)


def test_a_trace_holds_the_best_so_far():
    one = trace("TPE", [np.inf, 5.0, 7.0, 2.0, 2.0])
    assert (one.spent, one.best) == ([2.0, 4.0], [5.0, 2.0])
    assert trace("TPE", [np.inf]).least == trace("TPE", []).least == np.inf


def test_searches_are_compared_with_the_best_of_all():
    traces = [
        *(trace("jcontour", values, each=3) for values in ([4.0, 2.0], [2.02])),
        *(trace("Sobol", values) for values in ([9.0, 8.0, 2.03], [7.0, 6.0])),
    ]
    ours, theirs = tuners._summed_up(2, traces)
    assert (ours.best, ours.reached, ours.evaluations) == (2.0, 2, 3.0)
    assert (theirs.reached, theirs.evaluations) == (1, 3.0)


def test_nobody_arrives_where_nothing_is_within_the_limits():
    (row,) = tuners._summed_up(2, [trace("Sobol", [np.inf, np.inf])])
    assert (row.reached, row.evaluations) == (0, None)


@pytest.fixture
def small(monkeypatch, proportional_problem):
    """Two gains on a circle, the only problem."""
    problem = proportional_problem(AtMost(rms_increment=2e-5, rms_tracking_error=5e-4))
    start = {"x": jnp.asarray(0.3), "y": jnp.asarray(0.3)}
    monkeypatch.setattr(tuners, "PROBLEMS", {"gains": None})
    monkeypatch.setattr(
        tuners, "tuning_run", lambda flags: SimpleNamespace(problem=problem, start=start)
    )


@pytest.mark.slow
def test_a_run_goes_on_from_its_file(small, tmp_path):
    flags = Bench(what="tuners", seeds=1, evaluations=60, keep=tmp_path / "kept.json")
    lines = []
    first = measured(flags, lines.append)
    assert lines == [f"start 1 of 1: gains: {name}" for name in ("jcontour", *METHODS)]
    assert {row.method for row in first} == {"jcontour", *METHODS}
    assert all(row.weights == 2 and row.seeds == 1 for row in first)
    ours = first[0]
    assert ours.method == "jcontour" and ours.reached == 1
    assert ours.evaluations % 3 == 0 and ours.evaluations <= 60
    assert measured(flags, lines.append) == first and len(lines) == 1 + len(METHODS)
    more = measured(replace(flags, seeds=2, searches=("Sobol",)), lines.append)
    assert lines[1 + len(METHODS) :] == ["start 2 of 2: gains: Sobol"]
    assert {row.method: row.seeds for row in more} == {"Sobol": 2}


def test_looks_without_a_run_count_too(monkeypatch):
    """A start that is stabilised looks at its loops before the machine runs."""

    def advance(problem, weights, effort, state):
        looks = 0 if state.history else 2
        row = Evaluated(0, np.zeros(1), 5.0 - len(state.history), -1.0, None, False)
        return replace(state, history=[*state.history, row], looks=state.looks + looks)

    monkeypatch.setattr(tuners, "advance", advance)
    problem, start = Posed({"x": Positive()}), {"x": 1.0}
    search = tuners._ours(problem, start, np.zeros(1), 0, 16)
    assert search == ([5.0, 4.0, 3.0], [9.0, 12.0, 15.0])


def test_scattered_points_without_slopes_count_once(monkeypatch):
    def advance(problem, weights, effort, state):
        start = -1 if state.history else 0
        row = Evaluated(start, np.zeros(1), 5.0 - len(state.history), -1.0, None, False)
        return replace(state, history=[*state.history, row])

    monkeypatch.setattr(tuners, "advance", advance)
    problem = Posed({"x": Positive()})
    search = tuners._ours(problem, {"x": jnp.asarray(1.0)}, np.zeros(1), 0, 6)
    assert search == ([5.0, 4.0, 3.0, 2.0], [3.0, 4.0, 5.0, 6.0])


@dataclass(frozen=True)
class Posed:
    """A problem as far as its space."""

    space: dict


def test_the_table_says_who_arrives(capsys):
    traces = [trace("jcontour", [2.0], each=3), trace("Sobol", [9.0])]
    rows = tuners._summed_up(2, traces)
    show(console_of(), tuners.tables(rows))
    printed = capsys.readouterr().out
    words = printed.split()
    assert "jcontour" in words and "Sobol" in words
    assert "1 of 1" in printed and "0 of 1" in printed


def test_missing_libraries_are_named_with_what_installs_them(monkeypatch):
    monkeypatch.setattr(tuners, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="uv run --group bench jcontour bench tuners"):
        measured(Bench(what="tuners"), print)


def test_unknown_searches_are_named():
    with pytest.raises(ValueError, match="searches: needs names of jcontour, .*, received TPS"):
        measured(Bench(what="tuners", searches=("TPS",)), print)


LOWEST = np.array([1.3, -0.4])
ENOUGH = {"CMA-ES": 0.05, "TPE": 1.0, "Nelder-Mead": 0.05, "Sobol": 1.0}


@pytest.mark.parametrize("method", METHODS)
def test_a_method_comes_near_the_lowest_point_of_a_bowl_and_stops_when_its_budget_is_spent(method):
    tried = []

    def measure(z):
        if len(tried) == 300:
            raise Spent
        tried.append(z)
        return float(np.sum((z - LOWEST) ** 2))

    start, box = np.array([-2.0, 2.0]), np.array([[-7.0, -3.0], [3.0, 7.0]])
    with pytest.raises(Spent):
        METHODS[method](measure, start, box, 1)
    assert np.min(np.linalg.norm(np.array(tried) - LOWEST, axis=1)) < ENOUGH[method]
    np.testing.assert_allclose(tried[0], start, atol=4.0)
    assert np.all(np.array(tried) >= box[0] - 1e-9) and np.all(np.array(tried) <= box[1] + 1e-9)


@pytest.mark.slow
def test_values_are_those_of_the_tuner():
    run = tuning_run(PROBLEMS["square, increment limited"])
    problem, start = run.problem, run.start
    z = np.asarray(Chart(problem.space, start).coordinates())
    measure = measure_of(problem, start)
    for away in (0.0, 0.5):
        point, (merit, objective) = evaluate_point(problem, start, z + away), measure(z + away)
        excess = max(0.0, float(point.limits.max()))
        assert merit == pytest.approx(np.log(point.objective) + 10 * excess, rel=1e-9)
        assert objective == (np.inf if excess > 1e-6 else pytest.approx(point.objective))
    assert measure(z + 1000.0 * np.sign(z))[0] >= LOST  # nothing is finite there


@dataclass(frozen=True)
class Lost:
    """A point that diverges, by how far its runs leave their contour."""

    departures: np.ndarray
    diverged: bool = True


@pytest.mark.parametrize(
    ("departures", "away"),
    [([-3.0, 2.0], 2.0), ([-3.0, -1.0], 0.0), ([np.inf, 2.0], LOST), ([np.nan], LOST)],
)
def test_points_that_diverge_are_worse_the_farther_they_leave(monkeypatch, departures, away):
    monkeypatch.setattr(tuners, "evaluate_values", lambda *_: Lost(np.array(departures)))
    assert measure_of(None, None)(np.zeros(1)) == (LOST + away, np.inf)


def test_there_are_six_problems_of_2_to_14_weights():
    assert len(PROBLEMS) == 6
