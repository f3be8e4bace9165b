"""`jcontour tolerance`: what predictive control can promise on a part, and runs that keep it."""

from pathlib import Path

import numpy as np
import xarray as xr

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.designs.predictive.bounded import Keeper, keeper
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.results.run_metrics import ContourRead
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.tolerance_result import ToleranceResult
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.flags.loops import Tolerance
from jcontour.app.jobs.job import Pace, Task
from jcontour.app.machines.disturbance_bounds import (
    Bounds,
    bounds_of,
    linear_machine,
    warn_of_doubt,
)
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.reports import tables
from jcontour.app.reports.figures.loops.kept import kept_figure
from jcontour.app.reports.figures.shared.png import save_figure
from jcontour.app.reports.tolerance_tables import show_tolerance
from jcontour.app.runs.checks.machine_limits import Signals, limits_of_groups
from jcontour.app.runs.contour_summary import read_of
from jcontour.app.runs.forecast import Steps, outline
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.loops.kept_runs import Tried, kept_runs, promised_to
from jcontour.app.runs.tuning.results import machine_summary
from jcontour.qp.solvers import solver_named

PNG = "tolerance.png"
LONGEST = 100  # samples: beyond it a QP takes seconds


def command(flags: Tolerance) -> int:
    """The whole command: what is promised, runs, print; exit code."""
    machine = linear_machine(machine_named(flags.plant))
    warn_of_doubt(machine)
    bounds = bounds_of(machine, flags.force, flags.encoder_um)
    _check(flags, machine)
    task = job_named(flags.contour or machine.usual.simulated, Pace.of(flags, machine))
    asked = None if flags.tolerance_um is None else 1e-6 * flags.tolerance_um
    solver = solver_named(flags.solver)
    found = keeper(
        machine, flags.model_delay, task, bounds, flags.length, flags.offset_free, asked, solver
    )
    folder = created(flags, "tolerance")
    tried, plants = [], len(machine.family_names)
    console = tables.console_of(stderr=True, quiet=flags.json)
    doing = f"{2 + plants} runs with a QP at every sample"
    tables.say(console, outline(task, machine.model.dt, plants, doing))
    with console.status("solving") as status:
        steps = Steps(status, "run", 2 + plants)
        for one in kept_runs(found):
            tried.append(one)
            steps.done(len(tried))
    result = _result(found, task, bounds, tried)
    _save(found, tried, folder)
    save_figure(kept_figure(result, found.reference, [one.error for one in tried]), folder / PNG)
    write_result(folder, result)
    return finished(folder, result, flags, show_tolerance, _next(result), result.verdict)


def _check(flags: Tolerance, machine: LinearMachine) -> None:
    wanted = flags.tolerance_um
    if wanted is not None and not wanted > 0:
        raise ValueError(f"tolerance-um: needs to be above zero, received {wanted}")
    if not 0 <= flags.model_delay <= machine.delay:
        raise ValueError(
            f"model-delay: the unknown delay of {machine.name} is 0 to {machine.delay} samples, "
            f"received {flags.model_delay}"
        )
    if flags.length is not None and not 1 <= flags.length <= LONGEST:
        raise ValueError(f"length: needs 1 to {LONGEST} samples, received {flags.length}")


def _result(found: Keeper, task: Task, bounds: Bounds, tried: list[Tried]) -> ToleranceResult:
    machine, shares = found.machine, found.shares
    return ToleranceResult(
        machine=machine_summary(machine),
        contour=task.name,
        feed_law=task.feed_law,
        samples=task.samples,
        error=machine.error,
        force=bounds.force,
        encoder=bounds.encoder,
        plant=promised_to(found),
        length=found.mpc.response.length,
        promised=found.promised,
        shares={
            "what disturbances make of the tool": shares.disturbances,
            "what the encoders do not show": shares.unknown,
            "error of the undisturbed run": shares.nominal,
            "bend of the path": shares.bend,
        },
        limiting=found.mpc.least.limiting,
        control_limit=tuple(np.asarray(found.mpc.limits.control, float).tolist()),
        read=_read(found, task),
        runs=[one.row for one in tried],
        verdict=_verdict(found, task, tried),
    )


def _verdict(found: Keeper, task: Task, tried: list[Tried]) -> Verdict:
    """Limits of the machine, and runs within the bounds that left the tolerance."""
    output, control = (
        np.stack([np.asarray(getattr(one.run.rollout, name)) for one in tried])[None]
        for name in ("output", "control")
    )
    scored = np.asarray(found.reference.mask)[None, : found.reference.steps]
    seen = Signals(output, control, scored, [task.name], _names(tried))
    within = np.array([one.row.within for one in tried])
    left = [one.row for one in tried if one.row.within and not one.row.keeps(found.promised)]
    names = ", ".join(f"{row.plant} ({row.disturbance})" for row in left)
    fault = f"not kept within the bounds: {names}. This is a fault of jcontour: please report it"
    return Verdict.of(
        limits_of_groups(seen, found.machine, within),
        [fault] if left else [],
        help_with_limits=[
            "within the bounds the controller keeps the limits of control and speed; it does not "
            "know those of acceleration and control increment"
        ],
        passed="USE THIS TOLERANCE",
    )


def _names(tried: list[Tried]) -> list[str]:
    """Plant and disturbance of every run."""
    return [f"{one.row.plant}, {one.row.disturbance}" for one in tried]


def _read(found: Keeper, task: Task) -> ContourRead:
    return read_of(task, found.reference.dt)


def _save(found: Keeper, tried: list[Tried], folder: Path) -> None:
    """Every run at every sample."""
    machine, steps = found.machine, found.reference.steps
    outputs, controls, errors, slacks = (
        np.stack([np.asarray(column) for column in columns])
        for columns in zip(
            *(
                (
                    one.run.rollout.output,
                    one.run.rollout.control,
                    one.error,
                    one.run.report.fallback,
                )
                for one in tried
            ),
            strict=True,
        )
    )
    data = {
        "output": (("run", "time", "axis"), outputs, {"units": "m"}),
        "control": (("run", "time", "input"), controls, {"units": machine.control_unit}),
        "error": (("run", "time"), errors, {"units": "m"}),
        "fallback": (
            ("run", "time"),
            slacks.astype("i1"),
            {"long_name": "1 where a QP had no answer within the tolerance"},
        ),
    }
    time = found.reference.dt * np.arange(steps)
    axes, names = list(machine.axes), _names(tried)
    coordinates = {"time": ("time", time, {"units": "s"}), "axis": axes, "run": names}
    title = {"title": "jcontour tolerance", "promised": found.promised, **run_folder.versions()}
    save_dataset(xr.Dataset(data, coordinates, title), folder / "runs.nc")


def _next(result: ToleranceResult) -> list[str]:
    """What makes it smaller."""
    shares = result.shares
    largest = max(shares, key=lambda name: shares[name])
    helps = {
        "what disturbances make of the tool": "--force and --encoder-um say what acts on your "
        "machine; friction fed forward leaves less of it",
        "what the encoders do not show": "finer encoders, or --encoder-um where they err less",
        "error of the undisturbed run": "a lower --feed-mm-per-min or --acceleration",
        "bend of the path": "a lower --feed-mm-per-min, or a smaller --corner-tolerance-um",
    }
    return [f"Next: the largest share is {largest}: {helps[largest]}."]
