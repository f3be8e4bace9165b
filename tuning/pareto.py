"""The trade-off front: the best value of the objective for each of several budgets.

Each budget is a tuning problem of its own; the search goes from one to the next, begins where the
last one ended, and every point ever evaluated counts for every budget that it satisfies, so that a
larger budget is never worse.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jcontour.simulation.metrics import Metrics
from tuning.parameters import Chart, Weights
from tuning.problem import Problem
from tuning.tune import FEASIBLE, Evaluated, Settings, TuneState, advance


class FrontPoint(NamedTuple):
    """The best point found within one budget; the least violating one when `feasible` is False."""

    weights: Weights
    metrics: Metrics
    objective: float
    feasible: bool


@dataclass(frozen=True)
class FrontState:
    """Where the search stands: finished histories, the run in progress, and the start of all coordinates."""

    histories: list[list[Evaluated]] = field(default_factory=list)
    run: TuneState = field(default_factory=TuneState)


def trade_off_front(
    problems: Sequence[Problem],
    start: Weights,
    settings: Settings = Settings(),
    on_step: Callable[[FrontState], None] = lambda state: None,
) -> list[FrontPoint]:
    """One point per problem; the problems differ in their limits only (`AtMost` with growing budgets).

    Raises:
        ValueError: as `tune`, or no problem is given.
    """
    if not problems:
        raise ValueError("problems: needs at least one budget, received none")
    state = FrontState()
    while not done(problems, state):
        state = advance_front(problems, start, settings, state)
        on_step(state)
    return front_points(problems, start, state)


def done(problems: Sequence[Problem], state: FrontState) -> bool:
    """Whether every budget has been searched."""
    return len(state.histories) == len(problems)


def advance_front(
    problems: Sequence[Problem], start: Weights, settings: Settings, state: FrontState
) -> FrontState:
    """One step of the budget in progress, or the move to the next one."""
    problem = problems[len(state.histories)]
    if state.run.done:
        return FrontState([*state.histories, state.run.history])
    begin = _best(problem, state.histories[-1:]) if state.histories else None
    weights = start if begin is None else Chart(problem.space, start).weights(jnp.asarray(begin.z))
    return replace(state, run=advance(problem, weights, settings, state.run))


def front_points(
    problems: Sequence[Problem], start: Weights, state: FrontState
) -> list[FrontPoint]:
    """The best of everything evaluated so far for each budget searched.

    Raises:
        ValueError: every point diverged.
    """
    points = []
    for problem in problems[: len(state.histories)]:
        best = _best(problem, state.histories)
        if best is None:
            raise ValueError(
                "every start diverges: begin with a stabilising controller (see frozen_spectral_radius)"
            )
        weights = Chart(problem.space, start).weights(jnp.asarray(best.z))
        points.append(
            FrontPoint(weights, best.metrics, best.objective, _violation(problem, best) <= FEASIBLE)
        )
    return points


def _best(problem: Problem, histories: Sequence[list[Evaluated]]) -> Evaluated | None:
    sound = [row for history in histories for row in history if not row.diverged]
    return min(
        sound,
        key=lambda row: (max(_violation(problem, row), FEASIBLE), row.objective),
        default=None,
    )


def _violation(problem: Problem, row: Evaluated) -> float:
    return float(np.max(problem.limits(row.metrics), initial=-np.inf))
