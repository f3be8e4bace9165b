"""The trade-off front: the best value of the objective for each of several budgets.

Each budget is a tuning problem of its own. The search goes from one budget to the next and begins
where the last one ended. Every point ever evaluated counts for every budget that it satisfies, so
that a larger budget is never worse.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tuning.objectives import Limits, Outcome
from tuning.parameters import Chart, Weights
from tuning.point import FEASIBLE, Evaluated, sound
from tuning.problem import THOROUGH, Effort, Problem
from tuning.tuner import TuneState, advance


class FrontPoint(NamedTuple):
    """The best point within one budget; the least violating one when `feasible` is False."""

    weights: Weights
    outcome: Outcome
    objective: float
    feasible: bool


@dataclass(frozen=True)
class FrontState:
    """Complete state of a search."""

    # one for every budget that is finished
    histories: list[list[Evaluated]] = field(default_factory=list)
    run: TuneState = field(default_factory=TuneState)  # the run in progress


def trade_off_front(
    problems: Sequence[Problem],
    start: Weights,
    effort: Effort = THOROUGH,
    on_step: Callable[[FrontState], None] = lambda state: None,
) -> list[FrontPoint]:
    """One point per problem; the problems differ in their limits only.

    Args:
        problems: one for every budget, best from the smallest to the largest (`AtMost`).
        start: first weights.
        effort: of every budget.
        on_step: receives the state after every step, for progress and saving.

    Raises:
        ValueError: as `tune`, or no problem is given.
    """
    if not problems:
        raise ValueError("problems: needs at least one budget, received none")
    state = FrontState()
    while not done(problems, state):
        state = advance_front(problems, start, effort, state)
        on_step(state)
    return front_points(problems, start, state)


def done(problems: Sequence[Problem], state: FrontState) -> bool:
    """Whether every budget has been searched."""
    return len(state.histories) == len(problems)


def advance_front(
    problems: Sequence[Problem], start: Weights, effort: Effort, state: FrontState
) -> FrontState:
    """One step of the budget in progress, or the move to the next one."""
    problem, run = problems[len(state.histories)], state.run
    if run.done:
        return FrontState([*state.histories, run.history])
    if run.start < 0 and state.histories:  # once a budget: it reads all histories
        best = _best(problem, [row for history in state.histories for row in history])
        run = run if best is None else replace(run, begin=best.z)
    # the weights given stay the middle of the box that every budget searches
    return replace(state, run=advance(problem, start, effort, run))


def front_points(
    problems: Sequence[Problem], start: Weights, state: FrontState
) -> list[FrontPoint]:
    """The best of everything evaluated so far for each budget searched.

    Raises:
        ValueError: every point diverged.
    """
    evaluated = [row for history in state.histories for row in history]
    points = []
    for problem in problems[: len(state.histories)]:
        best = _best(problem, evaluated)
        if best is None:
            raise ValueError(
                "every start diverges: begin with a stabilising controller "
                "(see frozen_spectral_radius)"
            )
        weights = Chart(problem.space, start).weights(jnp.asarray(best.z))
        (violation,) = _violations(problem, [best])
        points.append(
            FrontPoint(weights, best.outcome, best.objective, bool(violation <= FEASIBLE))
        )
    return points


def _best(problem: Problem, evaluated: Sequence[Evaluated]) -> Evaluated | None:
    """The least violating of all points that did not diverge; of the feasible ones the best."""
    rows = sound(evaluated)
    if not rows:
        return None
    violations = np.maximum(_violations(problem, rows), FEASIBLE)
    objectives = np.array([row.objective for row in rows])
    return rows[np.lexsort((objectives, violations))[0]]


def _violations(problem: Problem, evaluated: Sequence[Evaluated]) -> Float[np.ndarray, " n"]:
    """Largest limit of every point under the limits of this problem."""
    outcomes = jax.tree.map(lambda *leaves: np.stack(leaves), *(row.outcome for row in evaluated))
    return np.asarray(_largest(problem.limits, outcomes))


@eqx.filter_jit
def _largest(limits: Limits, outcomes: Outcome) -> Float[Array, " n"]:
    """Largest entry of the limits of stacked outcomes."""
    return jax.vmap(lambda one: jnp.max(limits(one), initial=-jnp.inf))(outcomes)
