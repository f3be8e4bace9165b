"""`jcontour check RUN --in-linuxcnc`: the programs of a run in a real control."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from jcontour.app.commands.loops.export import exported_code, linuxcnc_components
from jcontour.app.files.checks import named
from jcontour.app.files.results.loop_results import InLinuxcncResult, InLinuxcncRow
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.loops import Check
from jcontour.app.jobs.job import Task
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import DESIRED, START, TUNED, save_figure
from jcontour.app.reports.figures.loops import ErrorCurve, errors_figure
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.checks.exported_code import (
    distance_to_path,
    missing,
    run_in_linuxcnc,
)
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.stored_loops import StoredLoop, stored_loop
from jcontour.export.linuxcnc import DRIVE
from jcontour.geometry.toolpath_rules import DRAWINGS
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import simulate

LONGER = 3.0  # times the planned motion, and LEAST, that a program may take
LEAST = 20.0  # [s]


def command(flags: Check) -> int:
    """The whole command: run, compare, print, exit code."""
    if lacking := missing():
        raise ValueError(f"in-linuxcnc: {lacking}")
    loop = stored_loop(flags.run)
    programs = [(job, Path(part)) for job, part in zip(loop.jobs, loop.parts, strict=False)]
    for _, part in programs:
        if part.suffix.lower() in ("", ".csv", *DRAWINGS):
            raise ValueError(f"in-linuxcnc: {part} is no program of G-code, LinuxCNC runs no other")
    rows, figures = [], {}
    for job, part in programs:
        with named(str(part)):
            row, figure = compared(loop, job, part.read_text())
        rows.append(row)
        figures[job.name] = figure
    folder = created(flags, "check")
    for name, figure in figures.items():
        save_figure(figure, folder / f"in-linuxcnc-{name}.png")
    result = InLinuxcncResult(
        checked=str(flags.run),
        controller=loop.name,
        machine=loop.machine.name,
        period=loop.machine.model.dt,
        rows=rows,
    )
    write_result(folder, result)
    worst = max(result.rows, key=lambda row: abs(row.real_rms / row.simulated_rms - 1))
    answer = [
        Entry(
            "Real", f"{result.controller} on {result.machine}, {1e3 * result.period:g} ms, LinuxCNC"
        ),
        *(
            Entry(
                row.contour,
                f"RMS contour error {1e6 * row.real_rms:.3g} um, simulate on the same samples "
                f"{1e6 * row.simulated_rms:.3g} um, LinuxCNC's own PID {1e6 * row.pid_rms:.3g} um; "
                f"{row.real_time:.3f} s, planned {row.planned_time:.3f} s",
            )
            for row in result.rows
        ),
        Entry("Apart", f"at most {100 * abs(worst.real_rms / worst.simulated_rms - 1):.2g} %"),
    ]
    return finished(folder, result, flags, show, answer)


def compared(loop: StoredLoop, job: Task, program: str) -> tuple[InLinuxcncRow, Figure]:
    """Errors of the real loop, of `simulate` on the planner's samples and on our own.

    Raises:
        ValueError: the loop cannot run in LinuxCNC; or as `run_in_linuxcnc`.
    """
    code, _ = exported_code(loop, job)
    components = linuxcnc_components(loop, code, display=DRIVE)
    longest = LEAST + LONGER * job.samples * loop.machine.model.dt
    real = run_in_linuxcnc(components, program, longest)
    stock = linuxcnc_components(loop, code, display=DRIVE, stock=True)
    pid = run_in_linuxcnc(stock, program, longest)
    plant, dt = loop.machine.true_family(loop.fed)[0], loop.machine.model.dt
    controller = loop.controller
    own = job.reference(dt, controller.preview)
    # From samples, from rest to rest; tangents by differences, as the law takes them
    held = np.concatenate([real.command, np.repeat(real.command[-1:], controller.preview, axis=0)])
    chord = np.gradient(held, axis=0)
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    tangent = np.where(length > 0.0, chord / np.maximum(length, 1e-300), 0.0)
    reference = Reference(
        position=jnp.asarray(held),
        tangent=jnp.asarray(tangent),
        arc=jnp.zeros(len(held)),
        mask=jnp.ones(len(held), bool),
        start_increment=jnp.zeros(held.shape[1]),
        contour=own.contour,
        dt=own.dt,
        steps=len(real.command),
    )
    same = np.asarray(simulate(plant, controller, reference).output)
    planned = np.asarray(simulate(plant, controller, own).output)
    errors = {
        "real": distance_to_path(real.command, real.tool),
        "pid": distance_to_path(pid.command, pid.tool),
        "simulated": distance_to_path(real.command, same),
        "planned": distance_to_path(np.asarray(own.position), planned),
    }
    rms = {name: float(np.sqrt(np.mean(error**2))) for name, error in errors.items()}
    row = InLinuxcncRow(
        contour=job.name,
        real_rms=rms["real"],
        real_peak=float(errors["real"].max()),
        pid_rms=rms["pid"],
        simulated_rms=rms["simulated"],
        simulated_peak=float(errors["simulated"].max()),
        planned_rms=rms["planned"],
        real_time=dt * real.samples,
        planned_time=dt * job.samples,
        samples=len(real.tool),
    )
    curves = [
        ErrorCurve("simulate, LinuxCNC's samples", errors["simulated"], DESIRED, 2.0),
        ErrorCurve("LinuxCNC's servo thread", errors["real"], TUNED),
        ErrorCurve("difference", np.abs(errors["real"] - errors["simulated"]), START),
    ]
    return row, errors_figure(f"{job.name} in LinuxCNC", "contour", reference, curves)


def show(result: InLinuxcncResult, console: Console) -> None:
    """What an error is; the screen has those of every part."""
    tables.say(
        console,
        "Errors are distances from the commanded path. No sample of the servo thread was lost.",
    )
