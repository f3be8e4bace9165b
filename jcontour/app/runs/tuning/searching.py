"""The search of a tuning run, round by round.

The first round is the search that the flags ask for. Then loops between the probes are looked at
(`tuning.exchange`); where one is worse, another round goes on with it, from where the last ended.
Every round has a folder of its own, so that an interrupted run goes on where it was.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from rich.console import Console

from jcontour.app.files.checkpoints import load_state, save_state
from jcontour.app.reports.tables import say
from jcontour.app.runs.tuning.limits import WINDOWS
from jcontour.app.runs.tuning.problem import TuningRun
from tuning.exchange import STABLE, exchanged, put_back, without_slope
from tuning.parameters import Chart
from tuning.point import FEASIBLE, evaluate_values
from tuning.tuner import Tuned, TuneState, advance, result

ROUNDS = 3  # after the first: each costs a part of it, and few contours need more than one
ROUND = "exchange-{}"
STEPS_BACK = (0.95, 0.8, 0.6, 0.4, 0.2, 0.0)  # of the way from the start to an end beyond a limit


class NothingSound(RuntimeError):
    """Every point of a search diverged."""


@dataclass(frozen=True)
class Searched:
    """End of a search."""

    run: TuningRun  # with the loops and limits that it ended with
    tuned: Tuned  # the best weights, with the points of all rounds
    descents: int  # of all rounds
    # coordinates that had no slope where the last descent ended
    flat: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    # names of the weights without any effect on the runs, which are left at their start
    idle: tuple[str, ...] = ()
    part: float = 1.0  # of the way from the start to the end of the search, see `suiting_all`


def searched(
    run: TuningRun, folder: Path, show: Callable[[TuneState], None], console: Console
) -> Searched:
    """Search, and exchange probes where a loop between them is worse.

    What is stored in the run folder counts. A later round that finds nothing sound leaves the
    result of the one before. Weights without any effect are left at their start.

    Raises:
        NothingSound: every point of the first round diverged.
    """
    # The same, with weights that have no effect where they started
    end = _within(_rounds(run, folder, show, console))
    problem, start = end.run.problem, end.run.start
    weights, idle = put_back(problem, start, end.tuned.weights, end.flat)
    if not idle.any():
        return end
    z = Chart(problem.space, start).coordinates()
    beside = jnp.where(idle, z + 1, z)
    first, moved = (Chart(problem.space, start).weights(at) for at in (z, beside))
    names = tuple(name for name in first if not np.array_equal(first[name], moved[name]))
    return replace(end, tuned=end.tuned._replace(weights=weights), idle=names)


def _within(end: Searched) -> Searched:
    """The end, or the farthest point on the way to it from the start that keeps every limit.

    Loops that a later round adds may leave the limits to no point that it tries, where points of
    the first round kept theirs.
    """
    tuned, problem, start = end.tuned, end.run.problem, end.run.start
    if tuned.feasible or not any(row.violation <= FEASIBLE for row in tuned.history):
        return end
    chart = Chart(problem.space, start)
    first = np.asarray(chart.coordinates())
    way = np.asarray(Chart(problem.space, tuned.weights).coordinates()) - first
    for part in STEPS_BACK:
        point = evaluate_values(problem, start, first + part * way)
        violation = float(np.max(point.limits, initial=-np.inf))
        if not point.diverged and violation <= FEASIBLE:
            there = tuned._replace(
                weights=chart.weights(jnp.asarray(first + part * way)),
                outcome=point.outcome,
                feasible=True,
                violation=violation,
                prices=[],
                exceeded=(),
            )
            return replace(end, tuned=there)
    return end


def _rounds(
    run: TuningRun, folder: Path, show: Callable[[TuneState], None], console: Console
) -> Searched:
    end = _round(run, folder, show, TuneState())
    for number in range(1, ROUNDS + 1):
        more = exchanged(end.run.problem, end.run.start, end.tuned, WINDOWS)
        if more is None:
            return end
        # A round of exchange in one line
        what = "is unstable" if more.unstable else "exceeds the limit on loops"
        looked = "1 more loop is" if more.added == 1 else f"{more.added} more loops are"
        say(
            console,
            f"A loop between the probes {what}: {looked} looked at, and the search goes on.",
        )
        place = folder / ROUND.format(number)
        place.mkdir(exist_ok=True)
        begin = Chart(more.problem.space, end.tuned.weights).coordinates()
        limits = end.run.limits  # the run goes on with more loops, and one descent
        if end.run.problem.loops is None:
            limits = {**limits, "spectral_radius": STABLE}
        settings = replace(end.run.settings, starts=1, scatter=0)
        wider = replace(end.run, problem=more.problem, settings=settings, limits=limits)
        try:
            later = _round(wider, place, show, TuneState(begin=np.asarray(begin)))
        except NothingSound:  # the checks that follow tell of the loop
            return end
        # The later round, with the points of those before
        moved = [
            (row._replace(start=row.start + end.descents) if row.start >= 0 else row)
            for row in later.tuned.history
        ]
        tuned = later.tuned._replace(
            history=[*end.tuned.history, *moved],
            diverged_points=end.tuned.diverged_points + later.tuned.diverged_points,
            diverged_starts=end.tuned.diverged_starts + later.tuned.diverged_starts,
            stabilised=end.tuned.stabilised,
        )
        end = Searched(later.run, tuned, end.descents + later.descents, later.flat)
    return end


def _round(
    run: TuningRun, folder: Path, show: Callable[[TuneState], None], fresh: TuneState
) -> Searched:
    state = load_state(folder)
    state = state if state.history else fresh
    while not state.done:
        state = advance(run.problem, run.start, run.settings, state)
        save_state(folder, state)
        show(state)
    try:
        tuned = result(run.problem, run.start, state)
        return Searched(run, tuned, state.start + 1, without_slope(state.descent))
    except ValueError as error:
        raise NothingSound(str(error)) from None
