"""`jcontour front`: the least contour error for every budget of the control increment.

All other limits hold at every point. The search is `tuning.pareto`. Where no largest budget is
given, it first tunes without one: the increment that those weights need is the largest budget that
can bite. Every search has a folder of its own inside the run folder, with the state of its tuner,
so that an interrupted front goes on where it was.

A machine that stands still at the start of its contour has no contour error. So the tracking error
is limited too, as in `jcontour tune`: as the flags say, or to a few samples of travel.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console

from experiments.catalogue.choices import machine_named
from experiments.designs.design import plain_weights
from experiments.files import run_folder
from experiments.files.checkpoints import load_state, save_state
from experiments.files.netcdf import metric_unit, save_dataset
from experiments.files.results import BESIDE_OTHERS, write_result
from experiments.options import Front, Spreading, Tune
from experiments.reports import tables
from experiments.reports.front_figure import Spent, front
from experiments.reports.png import save_figures
from experiments.reports.progress import progress_of
from experiments.runs.lifecycle import finished, opened
from experiments.runs.tuning import TuningRun, tuning_run
from jcontour.simulation.metrics import Metrics
from tuning.objectives import AtMost
from tuning.pareto import FrontPoint, FrontState, advance_front, done, front_points
from tuning.problem import Problem
from tuning.tune import QUICK, TuneState

# a budget begins where the one before ended, which may be a local optimum: several others help
EFFORT = replace(QUICK, starts=4, scatter=16, steps=40, tolerance=1e-4, every_start=True)
NO_BUDGET = 1e30  # control units: the search without a budget is the same program as with one
LEAST = 3 / 4  # smallest budget over the largest, where none is given
SLACK = 0.99  # part of a budget below which it is not used up
WITHOUT_BUDGET, BUDGETS = "without-budget", "budgets.json"


@dataclass(frozen=True)
class MachineUnits:
    """Units of the machine that the numbers need."""

    control_unit: str


@dataclass(frozen=True)
class BudgetPoint:
    """The best weights found within one budget, on the smooth machines.

    Attributes:
        budget: largest RMS control increment [control unit per sample].
        weights: those that are one number.
        rms_contour_error: worst over contours and family [m]; so are the next two.
        rms_tracking_error: [m].
        rms_increment: [control unit per sample].
        objective: worst error that was made small [m].
        feasible: whether every limit holds.
        slack: whether the weights need clearly less than the budget.
    """

    budget: float
    weights: dict[str, float] = field(metadata=BESIDE_OTHERS)
    rms_contour_error: float
    rms_tracking_error: float
    rms_increment: float
    objective: float
    feasible: bool
    slack: bool

    def error(self, name: str) -> float:
        """Worst RMS error of a name, contour or tracking [m]."""
        return getattr(self, f"rms_{name}_error")


@dataclass(frozen=True)
class FrontResult:
    """A front.

    Attributes:
        machine: its units.
        error: name of the error that counts on the machine, contour or tracking.
        controller: name in the catalogue.
        weights: names of the free weights.
        points: one for every budget, from the smallest.
        tracking_cap: limit on the RMS tracking error that no flag asked for [m]; None without it.
    """

    machine: MachineUnits
    error: str
    controller: str
    weights: list[str]
    points: list[BudgetPoint]
    tracking_cap: float | None = None

    @property
    def slack(self) -> list[float]:
        """Budgets that are not used up."""
        return [point.budget for point in self.points if point.slack]


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
        limits = AtMost(**{**self.run.limits, "rms_increment": budget})
        return replace(self.run.problem, limits=limits)


def command(flags: Front) -> int:
    """Trace, store and print a front; exit code."""
    with opened(flags, "front", search_of) as (folder, search):
        result = traced(search, folder, tables.console_of(quiet=flags.json))
        _store(result, search.run.design.units(), folder)
    return finished(folder, result, flags, show, next_steps(result))


def search_of(flags: Front) -> Search:
    """The search that flags describe.

    Raises:
        ValueError: a flag, a file or their combination is wrong.
    """
    if flags.max_rms_increment is not None or flags.points < 1:
        raise ValueError(
            "front: points needs at least 1, and --max-rms-increment is what the front varies: "
            "leave it out"
        )
    for name in ("least_increment", "most_increment"):
        value = getattr(flags, name)
        if value is not None and not (np.isfinite(value) and value > 0):
            flag = name.replace("_", "-")
            raise ValueError(f"{flag}: needs to be finite and above zero, received {value}")
    shared = {one.name: getattr(flags, one.name) for one in fields(Spreading)}
    parts = flags.parts or machine_named(flags.plant).usual.front
    run = tuning_run(Tune(**{**shared, "parts": parts}))
    asked = flags.max_tracking_error_um is not None or flags.max_peak_tracking_error_um is not None
    cap = None if asked else run.limits.get("rms_tracking_error")
    return Search(flags, replace(run, settings=replace(EFFORT, seed=flags.seed)), cap)


def traced(search: Search, folder: Path, console: Console) -> FrontResult:
    """The front; what is stored in the run folder counts.

    Raises:
        ValueError: every start diverges, or the smallest budget is above the largest.
    """
    run = search.run
    problems: list[Problem] = []
    places: list[Path] = []
    needed = None
    with progress_of(console, run.settings, run.machine.error) as show_progress:
        if _optimum_needed(search.flags, folder):
            problems, places = [search.within(NO_BUDGET)], [folder / WITHOUT_BUDGET]
            state = _searched(problems, places, run, show_progress)
            (optimum,) = front_points(problems, run.start, state)
            needed = _worst(optimum.outcome.metrics, "increment")
        budgets = _budgets(search.flags, needed, folder)
        problems += [search.within(budget) for budget in budgets]
        places += [folder / f"budget-{k}" for k in range(len(budgets))]
        state = _searched(problems, places, run, show_progress)
    found = front_points(problems, run.start, state)[-len(budgets) :]
    return FrontResult(
        machine=MachineUnits(run.machine.control_unit),
        error=run.machine.error,
        controller=run.design.name,
        weights=list(run.design.free()),
        points=[_point(budget, one) for budget, one in zip(budgets, found, strict=True)],
        tracking_cap=search.tracking_cap,
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
    chosen_before = (folder / BUDGETS).exists() and not (folder / WITHOUT_BUDGET).exists()
    return flags.most_increment is None and not chosen_before


def _budgets(flags: Front, needed: float | None, folder: Path) -> list[float]:
    """Budgets from the smallest to the largest, even in the logarithm.

    They are kept in the run folder once they are chosen.

    Raises:
        ValueError: the smallest is above the largest.
    """
    path = folder / BUDGETS
    if not path.exists():
        most = flags.most_increment or needed
        assert most is not None
        least = flags.least_increment or LEAST * most
        if least > most:
            raise ValueError(
                f"least-increment: {least:.4g} is above the largest budget, {most:.4g}"
                + ("" if flags.most_increment else ", which the best weights need without a budget")
            )
        run_folder.write_json(path, {"budgets": np.geomspace(least, most, flags.points)})
    return json.loads(path.read_text())["budgets"]


def _worst(metrics: Metrics, name: str) -> float:
    return float(np.max(getattr(metrics, f"rms_{name}")))


def _point(budget: float, found: FrontPoint) -> BudgetPoint:
    weights = plain_weights(found.weights).items()
    increment = _worst(found.outcome.metrics, "increment")
    feasible = bool(found.feasible)
    return BudgetPoint(
        budget=budget,
        weights={name: value for name, value in weights if isinstance(value, float)},
        rms_contour_error=_worst(found.outcome.metrics, "contour_error"),
        rms_tracking_error=_worst(found.outcome.metrics, "tracking_error"),
        rms_increment=increment,
        objective=found.objective,
        feasible=feasible,
        slack=feasible and increment < SLACK * budget,
    )


def _store(result: FrontResult, weight_units: dict[str, str], folder: Path) -> None:
    save_dataset(dataset_of(result, weight_units), folder / "front.nc")
    unit = result.machine.control_unit
    spent = [
        Spent(point.rms_increment, point.error(result.error), point.feasible, point.slack)
        for point in result.points
    ]
    save_figures({"front": lambda points: front(points, result.error, unit)}, spent, folder)
    write_result(folder, result)


def dataset_of(result: FrontResult, weight_units: dict[str, str]) -> xr.Dataset:
    """The front along its budgets."""
    unit = result.machine.control_unit

    def along(values: Sequence[float], of: str) -> tuple[str, np.ndarray, dict[str, str]]:
        return "budget", np.array(values, float), {"units": of}

    data: dict[str, Any] = {}
    for name, of in weight_units.items():
        data[name] = along([point.weights[name] for point in result.points], of)
    for name in ("rms_contour_error", "rms_tracking_error", "rms_increment"):
        values = [getattr(point, name) for point in result.points]
        data[name] = along(values, metric_unit(name, unit))
    for name in ("feasible", "slack"):
        data[name] = along([float(getattr(point, name)) for point in result.points], "1")
    budgets = along([point.budget for point in result.points], unit)
    attributes = {"title": "jcontour front", **run_folder.versions()}
    return xr.Dataset(data, {"budget": budgets}, attributes)


def show(result: FrontResult, console: Console) -> None:
    """Print the front as a table."""
    rows = []
    for point in result.points:
        numbers = [point.rms_increment, *(point.weights.get(name) for name in result.weights)]
        rows.append(
            [
                tables.digits(point.budget),
                *map(tables.digits, numbers),
                tables.digits(1e6 * point.error(result.error)),
                "yes" if point.feasible else "NO",
                "-" if not point.feasible else "no" if point.slack else "yes",
            ]
        )
    error = f"worst RMS {result.error} um"
    columns = ["budget", "RMS increment", *result.weights, error, "feasible", "used up"]
    console.print(tables.plain_table("Front (smooth machine)", columns, rows, text_columns=0))


def next_steps(result: FrontResult) -> list[str]:
    """Lines that say which budgets are slack, and what to do next."""
    lines = []
    if result.tracking_cap is not None:
        lines.append(
            f"The RMS tracking error is held below {1e6 * result.tracking_cap:.4g} um, "
            "a few samples of travel: a machine that stands still has no contour error. "
            "Another cap: --max-tracking-error-um."
        )
    if result.slack:
        slack = ", ".join(map(tables.digits, result.slack))
        lines.append(
            f"Slack: the best weights found need less than the budget {slack}. "
            "Give smaller budgets with --least-increment and --most-increment."
        )
    tight = [point for point in result.points if point.feasible and not point.slack]
    if tight:
        budget = tables.digits(tight[0].budget)
        lines.append(
            "Next: choose a budget and tune for it, as "
            f"jcontour tune --max-rms-increment {budget} with the same parts and machine."
        )
    else:
        lines.append("Next: no budget is met and used up; give larger or smaller ones.")
    return lines
