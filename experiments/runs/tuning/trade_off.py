"""Search of a front: the least error for every budget of the control increment, or of Ms.

All other limits hold at every point. The search is `tuning.pareto`. Where no largest budget of the
increment is given, it first tunes within the increment of the first weights, a calm loop, and goes
on from there without a budget: the increment that those weights need is the largest budget that can
bite. (A search that begins without a budget ends in rough weights more often than in good ones.)
Where no smallest is given, it is the increment of the first weights. Every search has a folder of
its own inside the run folder, with the state of its tuner, so that an interrupted front goes on
where it was.

A machine that stands still at the start of its contour has no contour error. So the tracking error
is limited too, as in `jcontour tune`: as the flags say, or to a few samples of travel.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from experiments.catalogue.choices import machine_named
from experiments.designs.design import plain_weights
from experiments.files import run_folder
from experiments.files.checkpoints import load_state, save_state
from experiments.files.results.front_result import BudgetPoint, FrontResult, MachineUnits
from experiments.flags.shared import Aimed
from experiments.flags.tuning import Front, Tune
from experiments.reports.progress import progress_of
from experiments.runs.tuning.family_loops import WINDOWS, probed_peaks
from experiments.runs.tuning.problem import TuningRun, tuning_run
from experiments.runs.tuning.regret import with_regret
from jcontour.analysis.probes import probe_windows
from jcontour.simulation.metrics import Metrics
from tuning.effort import QUICK
from tuning.objectives import AtMost
from tuning.parameters import Chart
from tuning.pareto import FrontPoint, FrontState, advance_front, done, front_points
from tuning.point import evaluate_values
from tuning.problem import Problem
from tuning.tune import TuneState

# a budget begins where the one before ended, which may be a local optimum: several others help
EFFORT = replace(QUICK, starts=4, scatter=16, steps=40, tolerance=1e-4, every_start=True)
NO_BUDGET = 1e30  # control units: the search without a budget is the same program as with one
LEAST = 3 / 4  # smallest budget over the largest, at most, where none is given
SENSITIVITIES = (1.4, 3.0)  # smallest and largest: very robust, and the most that should run
SLACK = 0.99  # part of a budget below which it is not used up
CALM, FREE, BUDGETS = "first-weights", "without-budget", "budgets.json"


@dataclass(frozen=True)
class Search:
    """A front that is asked for.

    Attributes:
        flags: as they are given.
        run: the tuning run without a budget.
        tracking_cap: limit on the RMS tracking error that no flag asks for [m].
    """

    flags: Front
    run: TuningRun
    tracking_cap: float | None = None

    def within(self, budget: float) -> Problem:
        """The tuning problem under a budget; problems that differ in it only share one program."""
        name = "rms_increment" if self.flags.against == "increment" else "peak_sensitivity"
        limits = AtMost(**{**self.run.limits, name: budget})
        return replace(self.run.problem, limits=limits)


def search_of(flags: Front) -> Search:
    """The search that flags describe.

    Raises:
        ValueError: a flag, a file or their combination is wrong.
    """
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
    """The front; what is stored in the run folder counts.

    Raises:
        ValueError: every start diverges, or the smallest budget is above the largest.
    """
    flags, run = search.flags, search.run
    problems: list[Problem] = []
    places: list[Path] = []
    calm, needed = None, None
    with progress_of(console, run.settings, run.machine.error) as show_progress:
        if flags.objective == "regret":
            run = with_regret(run, folder, show_progress)
            search = replace(search, run=run)
        if _optimum_needed(flags, folder):
            calm = _calm(search)
            if calm is not None:
                problems, places = [search.within(calm)], [folder / CALM]
            problems, places = [*problems, search.within(NO_BUDGET)], [*places, folder / FREE]
            state = _searched(problems, places, run, show_progress)
            needed = _worst(
                front_points(problems, run.start, state)[-1].outcome.metrics, "increment"
            )
        budgets = _budgets(flags, calm, needed, folder)
        problems += [search.within(budget) for budget in budgets]
        places += [folder / f"budget-{k}" for k in range(len(budgets))]
        state = _searched(problems, places, run, show_progress)
    found = front_points(problems, run.start, state)[-len(budgets) :]
    return FrontResult(
        machine=MachineUnits(run.machine.control_unit),
        error=run.machine.error,
        controller=run.design.name,
        weights=list(run.design.free()),
        points=[_point(search, budget, one) for budget, one in zip(budgets, found, strict=True)],
        tracking_cap=search.tracking_cap,
        against=flags.against,
        nominal_only=flags.nominal_only,
    )


def _searched(
    problems: Sequence[Problem],
    places: Sequence[Path],
    run: TuningRun,
    show_progress: Callable[[TuneState], None],
) -> FrontState:
    """The search through all problems; it goes on from the states that are stored in the places."""
    state = _load(places)
    while not done(problems, state):
        state = advance_front(problems, run.start, run.settings, state)
        k = len(state.histories)
        if k < len(places) and state.run.history:
            places[k].mkdir(exist_ok=True)
            save_state(places[k], state.run)
            show_progress(state.run)
    return state


def _load(places: Sequence[Path]) -> FrontState:
    """State of the search that the stored states of its problems add up to."""
    histories = []
    for place in places:
        run = load_state(place)
        if not run.done:
            return FrontState(histories, run)
        histories.append(run.history)
    return FrontState(histories)


def _optimum_needed(flags: Front, folder: Path) -> bool:
    """Whether the largest budget comes from a search without one; older runs have none."""
    chosen_before = (folder / BUDGETS).exists() and not (folder / FREE).exists()
    return flags.against == "increment" and flags.most is None and not chosen_before


def _calm(search: Search) -> float | None:
    """RMS increment of the first weights; None where they diverge."""
    problem, start = search.run.problem, search.run.start
    point = evaluate_values(problem, start, np.asarray(Chart(problem.space, start).coordinates()))
    return None if point.diverged else _worst(point.outcome.metrics, "increment")


def _budgets(flags: Front, calm: float | None, needed: float | None, folder: Path) -> list[float]:
    """Budgets from the smallest to the largest, even in the logarithm.

    They are kept in the run folder once they are chosen.

    Args:
        flags: may give the smallest and the largest.
        calm: increment of the first weights.
        needed: increment of the best weights without a budget.
        folder: of the run.

    Raises:
        ValueError: the smallest is above the largest.
    """
    path = folder / BUDGETS
    if not path.exists():
        least, most = _ends(flags, calm, needed)
        if least > most:
            raise ValueError(
                f"least: {least:.4g} is above the largest budget, {most:.4g}"
                + ("" if flags.most or needed is None else ", which the best weights need without")
            )
        budgets = np.geomspace(least, most, flags.points) if flags.points > 1 else [most]
        run_folder.write_json(path, {"budgets": budgets})
    return json.loads(path.read_text())["budgets"]


def _ends(flags: Front, calm: float | None, needed: float | None) -> tuple[float, float]:
    if flags.against == "sensitivity":
        return flags.least or SENSITIVITIES[0], flags.most or SENSITIVITIES[1]
    most = flags.most or needed
    assert most is not None
    return flags.least or min(LEAST * most, calm or np.inf), most


def _worst(metrics: Metrics, name: str) -> float:
    return float(np.max(getattr(metrics, f"rms_{name}")))


def _point(search: Search, budget: float, found: FrontPoint) -> BudgetPoint:
    known = search.run.design.units()  # a number for each sample of the horizon has no unit
    weights = plain_weights(found.weights).items()
    point = BudgetPoint(
        budget=budget,
        weights={name: w for name, w in weights if isinstance(w, float) or name in known},
        rms_contour_error=_worst(found.outcome.metrics, "contour_error"),
        rms_tracking_error=_worst(found.outcome.metrics, "tracking_error"),
        rms_increment=_worst(found.outcome.metrics, "increment"),
        objective=found.objective,
        feasible=bool(found.feasible),
        slack=False,
        peak_sensitivity=_peak_sensitivity(search.run.problem, found),
    )
    slack = point.feasible and point.spent(search.flags.against) < SLACK * budget
    return replace(point, slack=slack)


def _peak_sensitivity(problem: Problem, found: FrontPoint) -> float:
    """Largest Ms at the probes of the contours, over the plants that are tuned on."""
    loops = found.outcome.loops
    if loops is None:
        windows = probe_windows(problem.references, WINDOWS)
        loops = probed_peaks(problem.build(found.weights), problem.plants, windows)
    return float(np.max(loops.sensitivity))
