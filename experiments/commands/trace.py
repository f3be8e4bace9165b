"""`jcontour trace`: model predictive contouring control along a contour; the controller chooses its own speed."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from experiments.catalogue.choices import job_named, machine_named
from experiments.catalogue.contours import CONTOURS
from experiments.files import run_folder
from experiments.jobs.job import Pace
from experiments.machines.machine import Machine
from experiments.options import MachineFlags, Trace
from experiments.reports import tables
from experiments.reports.png import save_figures
from jcontour.geometry.contour import Contour
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.host.held import Held
from jcontour.host.loop import HostRun, Stopped, reported_loop
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.mpc.contouring import MPCC
from jcontour.mpc.contouring_weights import ContouringWeights
from jcontour.plant import Plant
from jcontour.plants.xy_table import FrictionXYTable, xy_table
from jcontour.qp.solvers import solver_named
from jcontour.simulation.traversal import traversal_score

TABLE_SAMPLE, TABLE_PERIOD, TABLE_CURRENT = (
    1e-3,
    4e-3,
    0.5,
)  # Lam's table: looked at every ms, controlled every 4 ms, [A]
SLOWEST = 0.02  # of the largest speed: a run that takes longer on average has stopped
LOBES = "lobes"
WEIGHTS = {  # field -> flag
    "contour_error": "q_contour",
    "lag": "q_lag",
    "progress": "q_theta",
    "control_change": "r_control",
    "speed_change": "r_speed",
}


class Setup(NamedTuple):
    """The machine as it is, the model that the controller has of it, samples per controller period, and the largest controls."""

    plant: Plant
    model: LinearPlant
    every: int
    limit: Any
    unit: str


def command(flags: Trace) -> int:
    """The whole command: trace, store what was simulated, print; exit code 1 where the run stopped or did not arrive."""
    setup, contour = setup_of(flags), contour_of(flags)
    controller = _controller(flags, setup, contour)
    steps = (
        int(float(contour.length) / (SLOWEST * 1e-3 * flags.max_speed_mm_s) / setup.plant.dt) + 1
    )
    reference = along(contour, np.zeros(steps), setup.plant.dt, 0, at_rest=True)
    held = Held(controller, setup.every, setup.model.inputs)
    held.initial_memory(reference)  # raises what does not fit before anything is written
    inputs = [Path(name) for name in (flags.plant, flags.contour) if Path(name).suffix]
    folder = run_folder.create(
        flags.out or run_folder.default_folder("trace"), "trace", flags, inputs
    )
    run, failure = _ran(
        setup.plant, held, reference, None if flags.fallback == "stop" else flags.fallback
    )
    summary = run_folder.plain(_summary(flags, setup, contour, controller, run, failure))
    save_figures({"trace": draw}, summary, folder)
    run_folder.write_json(folder / run_folder.RESULT, summary)
    if flags.json:
        print(run_folder.json_text({"run": str(folder), **summary}))
    else:
        show(summary, str(folder), tables.console_of())
    return 0 if summary["arrived"] else 1


def setup_of(flags: Trace) -> Setup:
    """The table with friction, or a linear machine of the catalogue or a file, its whole state measured.

    Raises:
        ValueError: no such machine, a period that is not a whole number of its samples, or no limit
            on the control is known.
    """
    if flags.plant == "xy-table":
        period = TABLE_PERIOD if flags.period_ms is None else 1e-3 * flags.period_ms
        return Setup(
            FrictionXYTable(TABLE_SAMPLE),
            xy_table(period),
            _every(period, TABLE_SAMPLE),
            flags.max_control or TABLE_CURRENT,
            "A",
        )
    machine: Machine = machine_named(flags.plant)
    limit = machine.limits.control if flags.max_control is None else flags.max_control
    if limit is None:
        raise ValueError(f"max-control: {machine.name} states no limit on its controls; give one")
    if flags.period_ms is not None and _every(1e-3 * flags.period_ms, machine.model.dt) != 1:
        raise ValueError(
            f"period-ms: {machine.name} is modelled at {1e3 * machine.model.dt:g} ms; leave the flag out"
        )
    return Setup(machine.model, machine.model, 1, limit, machine.control_unit)


def contour_of(flags: Trace) -> Contour:
    """The paper's kind of contour, or one of the catalogue or a file; its feed is not used.

    Raises:
        ValueError: no such contour, or a bad file.
    """
    if flags.contour == LOBES:
        return polar_lobes(30e-3, 10e-3, 4)
    pace = Pace.of(
        MachineFlags(feed_mm_per_min=3000.0),
        machine_named("bridgeport" if flags.plant == "xy-table" else flags.plant),
    )
    if not Path(flags.contour).suffix and flags.contour not in CONTOURS:
        raise ValueError(
            f"contour: there is none named {flags.contour!r}; give one of {LOBES}, {', '.join(CONTOURS)}, or a toolpath file"
        )
    return job_named(flags.contour, pace).contour


def _every(period: float, sample: float) -> int:
    every = round(period / sample)
    if every < 1 or abs(every * sample - period) > 1e-9:
        raise ValueError(
            f"period-ms: needs a whole number of samples of {1e3 * sample:g} ms, received {1e3 * period:g} ms"
        )
    return every


def _controller(flags: Trace, setup: Setup, contour: Contour) -> MPCC:
    limit, fastest = np.asarray(setup.limit, float), 1e-3 * flags.max_speed_mm_s
    try:
        weights = ContouringWeights(
            **{field: getattr(flags, flag) for field, flag in WEIGHTS.items()}
        )
        return MPCC(
            setup.model,
            contour,
            -limit,
            limit,
            fastest,
            weights,
            flags.horizon,
            solver_named(flags.solver),
        )
    except ValueError as error:  # names the library's field: the user knows the flag
        field, _, fault = str(error).partition(":")
        flag = {**WEIGHTS, "speed_limit": "max_speed_mm_s", "lower, upper": "max_control"}.get(
            field, field
        )
        raise ValueError(f"{flag.replace('_', '-')}:{fault}") from None


def _ran(plant: Plant, controller: Held, reference, fallback) -> tuple[HostRun, str]:
    try:
        return reported_loop(plant, controller, reference, fallback=fallback), ""
    except Stopped as stopped:
        return stopped.run, str(stopped)


def _summary(
    flags: Trace, setup: Setup, contour: Contour, controller: MPCC, run: HostRun, failure: str
) -> dict[str, Any]:
    common = {
        "plant": flags.plant,
        "contour": flags.contour,
        "control_unit": setup.unit,
        "length_mm": 1e3 * float(contour.length),
        "failure": failure,
        "steps": len(run.report.residual),
        "fallbacks": run.report.fallbacks,
        "limited": run.report.active_fraction,
        "residual": run.report.worst_residual,
    }
    if run.rollout.output is None:
        return {**common, "arrived": False, "time_s": None}
    score = traversal_score(
        contour,
        run.rollout.output,
        setup.plant.dt,
        progress=controller.arc(run.rollout.memory.inner),
    )
    signals = {
        "arc_mm": 1e3 * score.arc,
        "contour_error_um": 1e6 * score.error,
        "speed_mm_s": 1e3 * controller.speed(run.rollout.memory.inner),
        "tool_mm": 1e3 * np.asarray(run.rollout.output),
        "control": np.asarray(run.rollout.control),
    }
    arrived = bool(np.isfinite(score.time) and not failure)
    return {
        **common,
        "arrived": arrived,
        "time_s": score.time,
        "rms_um": 1e6 * score.rms,
        "peak_um": 1e6 * score.peak,
        "signals": signals,
    }


def draw(summary: dict[str, Any]) -> Figure:
    """Speed, contour error and controls along the path."""
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    signals = summary.get("signals")
    if signals:
        labels = ("path speed [mm/s]", "contour error [um]", f"control [{summary['control_unit']}]")
        for axes, name, label in zip(
            rows, ("speed_mm_s", "contour_error_um", "control"), labels, strict=True
        ):
            axes.plot(signals["arc_mm"], signals[name], linewidth=0.9)
            axes.set(ylabel=label)
            axes.grid(color="0.9")
            axes.margins(x=0.01)
    rows[0].set(
        title=f"{summary['contour']} on {summary['plant']}: model predictive contouring control"
    )
    rows[-1].set(xlabel="along the path [mm]")
    return figure


def show(summary: dict[str, Any], folder: str, console: Console) -> None:
    """How long, how far off, and whether the limits or the solver had a say."""
    lines = [
        f"{summary['contour']}: {summary['length_mm']:.4g} mm on {summary['plant']}, {summary['steps']} samples"
    ]
    time = (
        f"{tables.digits(summary['time_s'])} s"
        if summary["arrived"]
        else "none: the tool DID NOT ARRIVE at the end of the path"
    )
    lines.append(f"Traversal time    {time}")
    if "rms_um" in summary:
        lines.append(
            f"Contour error     RMS {summary['rms_um']:.4g} um, peak {summary['peak_um']:.4g} um"
        )
    lines.append(
        f"Limits in plan    {100 * summary['limited']:.4g} % of the steps; fallback steps: {summary['fallbacks']}"
    )
    lines.append(
        f"Worst residual    {summary['residual']:.1e} of a QP (at most 1e-8 counts as solved)"
    )
    if summary["failure"]:
        lines.append(f"STOPPED: {summary['failure']} (--fallback hold or soft goes on)")
    tables.say(console, *lines, f"Run folder: {folder}")
