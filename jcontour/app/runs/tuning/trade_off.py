"""Search of a front: the least error for every budget of the control increment, or of Ms.

All other limits hold at every point. The search is `tuning.pareto`. Where no largest budget of the
increment is given, it first tunes within the increment of the first weights, a calm loop, and goes
on from there without a budget: the increment that those weights need is the largest budget that can
bite. (A search that begins without a budget ends in rough weights more often than in good ones.)
Where no smallest is given, the least increment that all other limits allow is searched for: it is
that, and a little room. Every search has a folder of its own inside the run folder, with the state
of its tuner, so that an interrupted front goes on where it was.

A machine that stands still at the start of its contour has no contour error. So the tracking error
is limited too, as in `jcontour tune`: as the flags say, or to some samples of travel.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from jcontour.analysis.sensitivity import probe_windows
from jcontour.app.catalogue.choices import machine_named
from jcontour.app.designs.design import plain_weights
from jcontour.app.files import run_folder
from jcontour.app.files.checkpoints import load_state, save_state
from jcontour.app.files.results.search_results import BudgetPoint, FrontResult
from jcontour.app.flags.shared import Aimed
from jcontour.app.flags.tuning import Front, Tune
from jcontour.app.reports.progress import progress_of
from jcontour.app.runs.contour_summary import loop_summary
from jcontour.app.runs.tuning.limits import WINDOWS, probed_peaks
from jcontour.app.runs.tuning.problem import TuningRun, tuning_run
from jcontour.simulation.metrics import Metrics
from tuning.objectives import AtMost, worst_increment
from tuning.parameters import Chart
from tuning.pareto import FrontPoint, FrontState, advance_front, done, front_points
from tuning.point import FEASIBLE, Evaluated, evaluate_values, objective_value, sound
from tuning.problem import QUICK, Problem
from tuning.tuner import TuneState, advance

# a budget begins where the one before ended, which may be a local optimum: several others help
EFFORT = replace(QUICK, starts=4, scatter=16, steps=40, tolerance=1e-4, every_start=True)
NO_BUDGET = 1e30  # control units: the search without a budget is the same program as with one
ROOM = 1.01  # smallest budget over the least increment: room to search in
LEAST = 3 / 4  # smallest budget over the largest, where no weights keep the other limits
SENSITIVITIES = (1.4, 3.0)  # smallest and largest: very robust, and the most that should run
SLACK = 0.99  # part of a budget below which it is not used up
CALM, FREE, CALMEST, BUDGETS = "first-weights", "without-budget", "least-increment", "budgets.json"


@dataclass(frozen=True)
class Search:
    """A front that is asked for."""

    flags: Front  # as they are given
    run: TuningRun  # the tuning run without a budget
    tracking_cap: float | None = None  # limit on the RMS tracking error that no flag asks for [m]

    def within(self, budget: float) -> Problem:
        """The tuning problem under a budget; problems that differ in it only share one program."""
        name = "rms_increment" if self.flags.against == "increment" else "peak_sensitivity"
        limits = AtMost(**{**self.run.limits, name: budget})
        return replace(self.run.problem, limits=limits)


def search_of(flags: Front) -> Search:
    """The search that flags describe."""
    _check(flags)
    shared = {one.name: getattr(flags, one.name) for one in fields(Aimed)}
    shared["parts"] = flags.parts or machine_named(flags.plant).usual.front
    if flags.against == "sensitivity":
        shared["max_sensitivity"] = flags.most or SENSITIVITIES[1]
    run = tuning_run(Tune(**shared))
    asked = flags.max_tracking_error_um is not None or flags.max_peak_tracking_error_um is not None
    cap = None if asked else run.limits.get("rms_tracking_error")
    return Search(flags, replace(run, settings=replace(EFFORT, seed=flags.seed)), cap)


def _check(flags: Front) -> None:
    if flags.against == "feed":
        raise ValueError("resume: feeds are run anew, nothing of them is kept; leave it out")
    if flags.overrides != Front.overrides:
        raise ValueError("overrides: --against feed alone has feeds; leave it out")
    if flags.points < 1:
        raise ValueError(f"points: needs at least 1, received {flags.points}")
    varied = "max_rms_increment" if flags.against == "increment" else "max_sensitivity"
    if getattr(flags, varied) != getattr(Front(), varied):
        raise ValueError(f"{varied.replace('_', '-')}: the front varies it; leave it out")
    floor = 0.0 if flags.against == "increment" else 1.0
    for name in ("least", "most"):
        value = getattr(flags, name)
        if value is not None and not (np.isfinite(value) and value > floor):
            raise ValueError(f"{name}: needs to be finite and above {floor:g}, received {value}")


def traced(search: Search, folder: Path, console: Console) -> FrontResult:
    """The front; what is stored in the run folder counts."""
    flags, run = search.flags, search.run
    problems: list[Problem] = []
    places: list[Path] = []
    needed, least, state = None, None, FrontState()
    with progress_of(console, run.settings, run.machine.error) as show_progress:
        searched = flags.against == "increment"  # budgets that are not given come from searches
        if searched and flags.most is None:
            z = np.asarray(Chart(run.problem.space, run.start).coordinates())
            first = evaluate_values(run.problem, run.start, z)
            if not first.diverged:
                calm = _worst(first.outcome.metrics, "increment")
                problems, places = [search.within(calm)], [folder / CALM]
            problems, places = [*problems, search.within(NO_BUDGET)], [*places, folder / FREE]
            state = _searched(problems, places, run, show_progress)
            needed = _worst(
                front_points(problems, run.start, state)[-1].outcome.metrics, "increment"
            )
        if searched and flags.least is None:
            least, calmest = _calmest(search, state, folder / CALMEST, show_progress)
            state = replace(state, histories=[*state.histories, calmest])
            problems = [*problems, search.within(NO_BUDGET)]
        budgets = _budgets(flags, least, needed, folder)
        problems += [search.within(budget) for budget in budgets]
        places = [folder / f"budget-{k}" for k in range(len(budgets))]
        state = _searched(problems, places, run, show_progress, state.histories)
    front = front_points(problems, run.start, state)[-len(budgets) :]
    return FrontResult(
        **loop_summary(run.machine, run.design.name),
        weights=list(run.design.free()),
        points=[_point(search, budget, one) for budget, one in zip(budgets, front, strict=True)],
        tracking_cap=search.tracking_cap,
        against=flags.against,
        nominal_only=flags.nominal_only,
    )


def _searched(
    problems: Sequence[Problem],
    places: Sequence[Path],
    run: TuningRun,
    show_progress: Callable[[TuneState], None],
    before: Sequence[list[Evaluated]] = (),
) -> FrontState:
    """The search through all problems; it goes on from the states that are stored in the places."""
    state = _load(places, before)
    while not done(problems, state):
        state = advance_front(problems, run.start, run.settings, state)
        k = len(state.histories) - len(before)
        if k < len(places) and state.run.history:
            places[k].mkdir(exist_ok=True)
            save_state(places[k], state.run)
            show_progress(state.run)
    return state


def _load(places: Sequence[Path], before: Sequence[list[Evaluated]]) -> FrontState:
    """State of the search that the stored states of its problems add up to."""
    histories = [*before]
    for place in places:
        run = load_state(place)
        if not run.done:
            return FrontState(histories, run)
        histories.append(run.history)
    return FrontState(histories)


def _calmest(
    search: Search, before: FrontState, place: Path, show_progress: Callable[[TuneState], None]
) -> tuple[float | None, list[Evaluated]]:
    """The least increment within all other limits, and the points that were tried.

    None where no point keeps them. The objective of the points is that of the front.
    """
    run, problem, state = search.run, search.within(NO_BUDGET), load_state(place)
    known = sound([row for history in before.histories for row in history])
    if state.start < 0 and known:
        # the least violation, and of the feasible ones the least increment
        calmest = min(
            known,
            key=lambda row: (
                max(row.violation, FEASIBLE),
                _worst(row.outcome.metrics, "increment"),
            ),
        )
        state = replace(state, begin=calmest.z)
    asked = replace(problem, objective=worst_increment)
    while not state.done:
        state = advance(asked, run.start, QUICK, state)
        place.mkdir(exist_ok=True)
        save_state(place, state)
        show_progress(state)
    kept = [row for row in sound(state.history) if row.violation <= FEASIBLE]
    least = min((_worst(row.outcome.metrics, "increment") for row in kept), default=None)
    rows = []
    for row in state.history:
        objective = objective_value(np.asarray(problem.objective(row.outcome)))
        rows.append(row._replace(objective=objective))
    return least, rows


def _budgets(
    flags: Front, least_kept: float | None, needed: float | None, folder: Path
) -> list[float]:
    """Budgets from the smallest to the largest, even in the logarithm.

    They are kept in the run folder once they are chosen.
    """
    path = folder / BUDGETS
    if not path.exists():
        least, most = _ends(flags, least_kept, needed)
        if least > most:
            least_words = "" if flags.least else ", the least that the other limits allow,"
            most_words = "" if flags.most else ", which the best weights need without"
            raise ValueError(
                f"least: {least:.4g}{least_words} is above the largest budget, "
                f"{most:.4g}{most_words}"
            )
        budgets = np.geomspace(least, most, flags.points) if flags.points > 1 else [most]
        run_folder.write_json(path, {"budgets": budgets})
    return json.loads(path.read_text())["budgets"]


def _ends(flags: Front, least_kept: float | None, needed: float | None) -> tuple[float, float]:
    if flags.against == "sensitivity":
        return flags.least or SENSITIVITIES[0], flags.most or SENSITIVITIES[1]
    most = flags.most or needed
    assert most is not None
    if flags.least:
        return flags.least, most
    least = LEAST * most if least_kept is None else ROOM * least_kept
    return (least if flags.most else min(least, most)), most


def _worst(metrics: Metrics, name: str) -> float:
    return float(np.max(getattr(metrics, f"rms_{name}")))


def _point(search: Search, budget: float, best: FrontPoint) -> BudgetPoint:
    problem, known = search.run.problem, search.run.design.units()
    weights = plain_weights(best.weights).items()
    loops = best.outcome.loops
    if loops is None:
        windows = probe_windows(problem.references, WINDOWS)
        loops = probed_peaks(problem.plants, problem.build(best.weights), windows)
    point = BudgetPoint(
        budget=budget,
        # a number for each sample of the horizon has no unit
        weights={name: w for name, w in weights if isinstance(w, float) or name in known},
        rms_contour_error=_worst(best.outcome.metrics, "contour_error"),
        rms_tracking_error=_worst(best.outcome.metrics, "tracking_error"),
        rms_increment=_worst(best.outcome.metrics, "increment"),
        objective=best.objective,
        feasible=bool(best.feasible),
        slack=False,
        peak_sensitivity=float(np.max(loops.sensitivity)),
    )
    slack = point.feasible and point.spent(search.flags.against) < SLACK * budget
    return replace(point, slack=slack)
