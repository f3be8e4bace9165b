"""`jcontour front`: the least contour error for every budget of the control increment, under a tracking cap if one is given.

The search is `tuning.pareto`, from the smallest budget to the largest. Every budget has a folder of
its own inside the run folder, with the state of its tuner, so that an interrupted front goes on
within the budget.
"""

import json
from dataclasses import fields, replace
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
from experiments.options import Front, Spreading, Tune
from experiments.reports import figures, tables
from experiments.reports.progress import progress_of
from experiments.runs.lifecycle import inputs, resumed
from experiments.runs.tuning import TuningRun, start_metrics, tuning_run
from tuning.objectives import AtMost
from tuning.pareto import FrontPoint, FrontState, advance_front, done, front_points

EFFORT = {
    "scatter": 8,
    "starts": 2,
    "tolerance": 1e-4,
}  # for each budget, which begins where the one before ended


def command(flags: Front) -> int:
    """The whole command: trace, print, exit code."""
    folder, flags = resumed(flags, "front") if flags.resume else (None, flags)
    if flags.max_rms_increment is not None or flags.points < 1:
        raise ValueError(
            "front: points needs at least 1, and --max-rms-increment is what the front varies: leave it out"
        )
    for name in ("least_increment", "most_increment"):
        value = getattr(flags, name)
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(
                f"{name.replace('_', '-')}: needs to be finite and above zero, received {value}"
            )
    first = _tuning_run(flags)
    if folder is None:
        folder = run_folder.create(
            flags.out or run_folder.default_folder("front"),
            "front",
            replace(flags, json=False, out=None),
            inputs(flags),
        )
    console = tables.console_of(quiet=flags.json)
    with run_folder.locked(folder), run_folder.resumable("front", folder):
        points = _traced(flags, first, folder, console)
        summary = run_folder.plain(
            {
                "machine": {"control_unit": first.machine.control_unit},
                "error": first.machine.error,
                "controller": first.design.name,
                "weights": first.design.free(),
                "points": points,
            }
        )
        _store(summary, first.design.units(), folder)
    if flags.json:
        print(run_folder.json_text({"run": str(folder), **summary}))
        return 0
    error = f"rms_{summary['error']}_error"
    rows = [
        [
            tables.digits(p["budget"]),
            *(tables.digits(p[n]) for n in ("rms_increment", *summary["weights"])),
            tables.digits(1e6 * p[error]),
            "yes" if p["feasible"] else "NO",
        ]
        for p in summary["points"]
    ]
    headings = [
        "budget",
        "RMS increment",
        *summary["weights"],
        f"worst RMS {summary['error']} um",
        "feasible",
    ]
    console.print(tables.plain_table("Front (smooth machine)", headings, rows, text_columns=0))
    tables.say(console, f"Run folder: {folder}")
    return 0


def _tuning_run(flags: Front) -> TuningRun:
    shared = {f.name: getattr(flags, f.name) for f in fields(Spreading)}
    return tuning_run(
        Tune(**{**shared, "parts": flags.parts or machine_named(flags.plant).usual.front, **EFFORT})
    )


def _traced(flags: Front, job: TuningRun, folder: Path, console: Console) -> list[dict[str, Any]]:
    budgets = _budgets(flags, job, folder)
    problems = [
        replace(job.problem, limits=AtMost(**{**job.limits, "rms_increment": budget}))
        for budget in budgets
    ]
    places = [folder / f"budget-{k}" for k in range(len(budgets))]
    state = _load(places)
    with progress_of(console, job.settings, job.machine.error) as show:
        while not done(problems, state):
            state = advance_front(problems, job.start, job.settings, state)
            k = len(state.histories)
            if k < len(places) and state.run.history:
                places[k].mkdir(exist_ok=True)
                save_state(places[k], state.run)
                show(state.run)
    return [
        _point(budget, found)
        for budget, found in zip(budgets, front_points(problems, job.start, state), strict=True)
    ]


def _load(places: list[Path]) -> FrontState:
    """The state that the stored states of the budgets add up to."""
    histories = []
    for place in places:
        run = load_state(place)
        if not run.done:
            return FrontState(histories, run)
        histories.append(run.history)
    return FrontState(histories)


def _budgets(flags: Front, job: TuningRun, folder: Path) -> list[float]:
    """From the smallest to the largest, even in the logarithm; kept in the run folder once chosen."""
    path = folder / "budgets.json"
    if not path.exists():
        needed = float(np.max(start_metrics(job.problem, job.start).rms_increment))
        least, most = flags.least_increment or needed / 2, flags.most_increment or 2 * needed
        run_folder.write_json(path, {"budgets": np.geomspace(least, most, flags.points)})
    return json.loads(path.read_text())["budgets"]


def _point(budget: float, found: FrontPoint) -> dict[str, Any]:
    metrics = {
        name: float(np.max(getattr(found.metrics, name)))
        for name in ("rms_contour_error", "rms_tracking_error", "rms_increment")
    }
    weights = {
        name: value
        for name, value in plain_weights(found.weights).items()
        if isinstance(value, float)
    }
    return {
        "budget": budget,
        **weights,
        **metrics,
        "objective": found.objective,
        "feasible": bool(found.feasible),
    }


def _store(summary: dict[str, Any], weight_units: dict[str, str], folder: Path) -> None:
    points, unit = summary["points"], summary["machine"]["control_unit"]
    metrics = {
        name: metric_unit(name, unit)
        for name in ("rms_contour_error", "rms_tracking_error", "rms_increment")
    }
    units = weight_units | metrics | {"feasible": "1"}
    data = {
        name: (("budget",), np.array([float(p[name]) for p in points]), {"units": of})
        for name, of in units.items()
    }
    budget = ("budget", [p["budget"] for p in points], {"units": unit})
    save_dataset(
        xr.Dataset(data, {"budget": budget}, {"title": "jcontour front", **run_folder.versions()}),
        folder / "front.nc",
    )
    figures.draw_front(summary, folder)
    run_folder.write_json(folder / run_folder.RESULT, summary)
