import pickle
from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning import pareto
from tuning.objectives import AtMost
from tuning.parameters import Positive
from tuning.pareto import FrontState, advance_front, done, front_points, trade_off_front
from tuning.problem import THOROUGH

START = {"x": jnp.asarray(0.3), "y": jnp.asarray(0.3)}
SETTINGS = replace(THOROUGH, starts=4, scatter=8, spread=1.0, steps=20)
BUDGETS = [1.2e-5, 2e-5, 2.8e-5]


@pytest.fixture(scope="module")
def problems(proportional_problem):
    return [
        proportional_problem(AtMost(rms_increment=budget, rms_tracking_error=5e-4))
        for budget in BUDGETS
    ]


@pytest.fixture(scope="module")
def states(problems):
    seen = [FrontState()]
    points = trade_off_front(problems, START, SETTINGS, seen.append)
    return seen, points


def test_points_respect_their_budgets_and_larger_budgets_are_never_worse(states):
    points = states[1]
    assert len(points) == 3
    for point, budget in zip(points, BUDGETS, strict=True):
        assert point.feasible
        assert float(point.outcome.metrics.rms_increment.max()) <= budget * (1 + 1e-6)
        assert point.objective == pytest.approx(
            float(point.outcome.metrics.rms_contour_error.mean())
        )
    assert [p.objective for p in points] == sorted((p.objective for p in points), reverse=True)
    assert points[0].objective > 1.01 * points[-1].objective  # there is a trade-off


def test_every_point_counts_for_every_budget(problems, states):
    """The order in which the budgets were searched does not matter for the points."""
    histories = states[0][-1].histories
    swapped = front_points(problems, START, FrontState(histories[::-1]))
    assert [p.objective for p in swapped] == [p.objective for p in states[1]]


def test_interrupted_it_goes_on_with_the_same_bits(problems, states):
    seen = states[0]
    for k in (0, len(seen) // 2, len(seen) - 2):
        again = advance_front(problems, START, SETTINGS, pickle.loads(pickle.dumps(seen[k])))
        leaves = [
            jax.tree.leaves((s.histories, s.run.history, s.run.descent, s.run.prices, s.run.begin))
            for s in (again, seen[k + 1])
        ]
        assert len(leaves[0]) == len(leaves[1])
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(*leaves, strict=True))
    assert done(problems, seen[-1]) and not done(problems, seen[-2])


def test_a_history_is_read_once_a_budget(problems, states, monkeypatch):
    """Every later step of the budget begins where the first one did, without looking again."""
    begun = next(s for s in states[0] if len(s.histories) == 1 and s.run.history)
    assert begun.run.begin.size
    monkeypatch.setattr(pareto, "_best", lambda *_: pytest.fail("the history is read again"))
    after = advance_front(problems, START, SETTINGS, begun)
    np.testing.assert_array_equal(after.run.begin, begun.run.begin)


def test_every_budget_searches_the_same_box(proportional_problem):
    """Half a unit of ln(weight) from the first weights, however many budgets are searched."""

    class Near(Positive):
        reach: ClassVar[float] = 0.5

    problems = [
        eqx.tree_at(
            lambda one: one.space,
            proportional_problem(AtMost(rms_increment=budget)),
            {"x": Near(), "y": Near()},
            is_leaf=lambda one: isinstance(one, dict),
        )
        for budget in (1.0, 2.0, 3.0, 4.0)  # none bites: the least error is far outside of the box
    ]
    start = {"x": jnp.asarray(0.05), "y": jnp.asarray(0.05)}
    for point in trade_off_front(problems, start, replace(SETTINGS, starts=1, scatter=0)):
        for name, first in start.items():
            assert abs(np.log(point.weights[name] / first)) == pytest.approx(0.5, abs=1e-9)


def test_no_budget_is_refused():
    with pytest.raises(ValueError, match="problems: needs at least one budget"):
        trade_off_front([], START)


def test_every_point_diverging_is_an_error(problems):
    far = {"x": jnp.asarray(1e30), "y": jnp.asarray(1e30)}
    with pytest.raises(ValueError, match="every start diverges"):
        trade_off_front(problems[:1], far, replace(THOROUGH, starts=1, scatter=2, spread=0.1))
