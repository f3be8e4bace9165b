"""`jcontour tolerance`: largest error that predictive control promises on a part, and its runs."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import xarray as xr
from rich.console import Console

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.designs.bounded import Keeper, keeper
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.results.bound_results import KeptRun, ToleranceResult
from jcontour.app.files.results.run_metrics import ContourRead
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import Verdict, reason
from jcontour.app.flags.loops import Tolerance
from jcontour.app.jobs.job import Pace, Task
from jcontour.app.machines.disturbance_bounds import (
    Bounds,
    bounds_of,
    linear_machine,
    warn_of_doubt,
)
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Machine
from jcontour.app.reports import tables
from jcontour.app.reports.figures.loops import ErrorCurve, errors_figure
from jcontour.app.reports.figures.png import save_figure
from jcontour.app.reports.progress import counted
from jcontour.app.reports.screen import Entry, read_notes
from jcontour.app.reports.tables import (
    digits,
    of_axes,
    of_inputs,
    plain_table,
    read_line,
    say,
    table_of,
)
from jcontour.app.runs.checks.machine_limits import Signals, limits_of_groups
from jcontour.app.runs.contour_summary import machine_summary, read_of
from jcontour.app.runs.forecast import outline
from jcontour.app.runs.lifecycle import created, finished
from jcontour.bounds.attacks import Attack
from jcontour.host.loop import HostRun, reported_loop
from jcontour.plant import Plant
from jcontour.plants.encoders import Encoders
from jcontour.qp.solvers import solver_named
from jcontour.simulation.metrics import contour_error, tracking_error

FORGOTTEN = 8  # times the length of the responses: an attack of the filter and them
PNG = "tolerance.png"
LONGEST = 100  # samples: beyond it a QP takes seconds


class Tried(NamedTuple):
    """A run and its error at every sample (T,) [m]."""

    row: KeptRun
    run: HostRun
    error: np.ndarray


def kept_runs(keeper: Keeper, seed: int = 0) -> Iterator[Tried]:
    """All runs, one after the other; those within the bounds come first."""
    machine, model = keeper.machine, Encoders(keeper.model)
    proven = promised_to(keeper)
    steps = keeper.reference.steps
    yield _tried(keeper, proven, "an attack", True, attacked(keeper, steps).on(model))
    random = at_random(keeper, steps, np.random.default_rng(seed))
    yield _tried(keeper, proven, "at random", True, random.on(model))
    yield _tried(keeper, proven, "encoder counts", True, machine.counted(keeper.model))
    for name, plant in zip(machine.family_names, machine.true_family(), strict=True):
        if name != proven:
            yield _tried(keeper, name, "encoder counts", False, plant)


def promised_to(keeper: Keeper) -> str:
    """The plant that the model is of: name of the member of the family."""
    machine, same = keeper.machine, np.ones(keeper.model.inputs)
    return next(
        name
        for name, gains, late in machine.members
        if late == keeper.late and np.array_equal(gains, same)
    )


def attacked(keeper: Keeper, steps: int) -> Attack:
    """The attack across the path where it is worst off, from either side in turn."""
    frames = keeper.mpc.certified(keeper.reference)
    worst = int(np.argmax(frames.certified[:steps]))
    direction = frames.directions[worst, -1]
    length = min(FORGOTTEN * keeper.mpc.response.length, steps)
    once = keeper.response.attack(keeper.model, keeper.around, direction, length)
    both = [np.concatenate([rows, -rows]) for rows in once]
    # one of them ends at the sample that needs most
    turned = [np.roll(rows, (worst + 1) % len(rows), axis=0) for rows in both]
    return Attack(*(np.resize(rows, (steps, rows.shape[1])) for rows in turned))


def at_random(keeper: Keeper, steps: int, generator: np.random.Generator) -> Attack:
    """Forces and encoder errors at an end of their range, from sample to sample at random."""
    model, around = keeper.model, keeper.around
    force = np.sign(generator.normal(size=(steps, model.inputs))) * np.asarray(around.force)
    return Attack(force, np.sign(generator.normal(size=(steps, model.axes))) * around.encoder)


def _tried(keeper: Keeper, name: str, disturbance: str, within: bool, plant: Plant) -> Tried:
    reference = keeper.reference
    run = reported_loop(plant, keeper.controller, reference, fallback="soft")
    error = _error(keeper.machine, run, reference)
    memory, report = run.rollout.final_memory.inner, run.report
    scored = np.asarray(reference.mask)[: reference.steps]
    row = KeptRun(
        plant=name,
        disturbance=disturbance,
        within=within,
        largest=float(np.max(error[scored])),
        left=None if memory.left < 0 else int(memory.left),
        fallbacks=report.fallbacks,
        control=tuple(np.abs(run.rollout.control).max(axis=0).tolist()),
        residual=report.worst_residual,
    )
    return Tried(row, run, error)


def _error(machine: Machine, run: HostRun, reference) -> np.ndarray:
    kind = tracking_error if machine.error == "tracking" else contour_error
    return np.linalg.norm(
        np.asarray(kind(jax.numpy.asarray(run.rollout.output), reference)), axis=1
    )


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
    with counted(console, 2 + plants) as done:
        for one in kept_runs(found):
            tried.append(one)
            done(1)
    result = _result(found, task, bounds, tried)
    _save(found, tried, folder)
    curves = [
        ErrorCurve(name, one.error, f"C{k}", 1.0 if one.row.within else 0.5)
        for k, (name, one) in enumerate(zip(_names(tried), tried, strict=True))
    ]
    title = f"{result.contour} on {machine.name}: promised {1e6 * result.promised:.4g} um"
    figure = errors_figure(title, machine.error, found.reference, curves, result.promised)
    save_figure(figure, folder / PNG)
    write_result(folder, result)
    promised = f"{digits(1e6 * result.promised)} um {result.error} error, {promise(result)[0]}"
    answer = [Entry("Promised", promised), *(Entry("Kept", line) for line in findings(result))]
    answer += read_notes(result.contour, result.read)
    return finished(
        folder, result, flags, show_tolerance, [*answer, *_next(result)], result.verdict
    )


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
        [reason(fault)] if left else [],
        limit_remedies=[
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


def _next(result: ToleranceResult) -> list[Entry]:
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
    return [Entry("Next", f"the largest share is {largest}: {helps[largest]}")]


def show_tolerance(result: ToleranceResult, console: Console) -> None:
    """What is promised and why it is not less, the runs, and a sentence."""
    if result.read is not None:
        say(console, f"Read {read_line(result.contour, result.read, result.machine.axes)}")
    least = sum(result.shares.values())
    sizes = {**result.shares, "the least that can be promised": least, "promised": result.promised}
    shares = [[name, f"{1e6 * size:.3f}"] for name, size in sizes.items()]
    title = f"Tolerance of {result.contour} on {result.machine.name}"
    console.print(plain_table(title, ["share", "um"], shares))
    say(console, *promise(result), "")
    title = f"Runs, {result.samples} samples, {result.feed_law}"
    columns: dict[str, Callable[[KeptRun], str | float]] = {
        "plant": lambda run: run.plant,
        "what acts": lambda run: run.disturbance,
        "largest\nerror um": lambda run: 1e6 * run.largest,
        "of the\ntolerance": lambda run: f"{100 * run.largest / result.promised:.0f} %",
        "largest\ncontrols": lambda run: ", ".join(map(digits, run.control)),
        "samples\nwithout answer": lambda run: str(run.fallbacks),
        "left the bounds\nat sample": lambda run: "" if run.left is None else str(run.left),
    }
    console.print(table_of(title, result.runs, columns, text_columns=2))
    say(console, *findings(result))


def promise(result: ToleranceResult) -> list[str]:
    """What is promised, under which conditions, and what keeps it from being smaller."""
    unit = result.machine.control_unit
    limiting = ", ".join(result.limiting)
    why = f"the limits of {limiting}" if limiting else "the machine alone, none of its limits"
    most = of_inputs(dict(enumerate(result.control_limit)), unit)
    return [
        f"proven for every force of up to {digits(result.force)} {unit} on each control and every "
        f"encoder error of up to {of_axes(result.encoder, result.machine.axes)}, at each sample,",
        f"on one plant, {result.plant}; no control above {most}. A disturbance is forgotten after "
        f"{result.length} samples. What decides: {why}.",
    ]


def findings(result: ToleranceResult) -> list[str]:
    """Whether it was kept, by whom, and what the others lack."""
    within = [run for run in result.runs if run.within]
    if not all(run.keeps(result.promised) for run in within):
        return []  # the verdict names them
    most = max(run.largest for run in within) / result.promised
    told = [
        f"Kept in all {len(within)} runs within the bounds: they reach {100 * most:.0f} % of it."
    ]
    others = [run for run in result.runs if not run.within]
    over = [run.plant for run in others if not run.keeps(result.promised)]
    if over:
        told.append(
            f"NOT FOR THE WHOLE FAMILY: {'; '.join(over)} left the tolerance. Nothing is promised "
            "for plants that differ from the model: load it on a machine whose delay and gains you "
            "know. `jcontour check --bound` bounds the error of a tuned loop on every plant."
        )
    elif others:
        told.append("The other plants kept it too, though nothing is promised for them.")
    return told
