"""`jcontour trace`: model predictive contouring control, which chooses its own speed."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike
from rich.console import Console

from experiments.catalogue.choices import job_named, machine_named
from experiments.designs.predictive.constrained import (
    Traverser,
    control_limit,
    traverser,
    waiting_reference,
)
from experiments.files.results.run_metrics import ContourRead
from experiments.files.results.stored import write_result
from experiments.flags.loops import Trace
from experiments.flags.shared import MachineFlags
from experiments.jobs.job import Job, Pace, Task
from experiments.machines.machine import Machine
from experiments.reports import tables
from experiments.reports.figures.loops.traversal import path_figure, signals_figure
from experiments.reports.figures.shared.png import save_figures
from experiments.runs.contour_summary import read_of
from experiments.runs.lifecycle import created, finished
from jcontour.geometry.contour import Contour
from jcontour.geometry.drawings.reading import SUFFIXES as DRAWINGS
from jcontour.geometry.toolpaths import Toolpath
from jcontour.host.held import Held
from jcontour.host.loop import HostRun, Stopped, reported_loop
from jcontour.motion.references import Reference
from jcontour.mpc.contouring.mpcc import ARRIVAL
from jcontour.simulation.traversal import END_MARGIN, Score, traversal_score

# [m] from the end at the last sample: the controller ends a run once it has measured the tool
# within ARRIVAL, and the tool moves on for up to two of its periods until it acts on that
AT_END = 10 * ARRIVAL
FULL = 0.9  # of its limit: a control that has come so far is short of it


@dataclass(frozen=True)
class Signals:
    """Signals of a run, one row per sample of the plant."""

    arc_mm: np.ndarray
    contour_error_um: np.ndarray
    speed_mm_s: np.ndarray
    tool_mm: np.ndarray
    control: np.ndarray


@dataclass(frozen=True)
class Traversed:
    """Result of `trace`.

    Attributes:
        failure: why it stopped, in one line; empty when it went through.
        steps: samples that were simulated.
        fallbacks: of these, those that the fallback made.
        limited: of these, the fraction with a limit active in the plan.
        residual: the worst of any QP.
        arrived: the tool came to the end of the path, and was there at the last sample.
        time_s: until the margin of `traversal_score` before the end; None where it did not arrive.
        came_mm: farthest along the path.
        end_mm: distance of the tool from the end of the path at the last sample.
        rms_um: contour error of the whole path; None where the tool did not come to its end.
        peak_um: its largest, likewise.
        control_used: largest size of every control.
        control_limit: of every control.
        read: file behind the contour; None where there is none.
        axes: names.
        lost: what of the file is not kept, in words.
    """

    plant: str
    contour: str
    control_unit: str
    length_mm: float
    failure: str
    steps: int
    fallbacks: int
    limited: float
    residual: float
    arrived: bool
    time_s: float | None
    came_mm: float | None = None
    end_mm: float | None = None
    rms_um: float | None = None
    peak_um: float | None = None
    control_used: tuple[float, ...] = ()
    control_limit: tuple[float, ...] = ()
    signals: Signals | None = None
    read: ContourRead | None = None
    axes: tuple[str, ...] = ()
    lost: str = ""


class Drawn(NamedTuple):
    """Content of the figures: the result, and its path in mm nearest to the tool."""

    result: Traversed
    foot_mm: np.ndarray


def command(flags: Trace) -> int:
    """The whole command; exit code 1 where the run stopped or did not arrive."""
    machine = machine_named(flags.plant)
    job = job_of(flags)
    asked = traverser(machine, job.contour, flags)
    reference, controller = waiting_reference(asked, 1e-3 * flags.max_speed_mm_s), asked.controller
    controller.initial_memory(reference)  # raises what does not fit before anything is written
    folder = created(flags, "trace")
    with tables.console_of(quiet=flags.json).status("solving a QP at every step"):
        run, failure = _ran(asked, controller, reference, flags)
    result = replace(_result(flags, asked, run, failure), **of_file(job, machine, flags.contour))
    if result.signals is not None:
        foot = np.asarray(asked.contour.position(1e-3 * result.signals.arc_mm))
        figures = {"trace": _signals, "path": _path}
        save_figures(figures, Drawn(result, 1e3 * foot), folder)
    write_result(folder, result)
    finished(folder, result, flags, show, _next(result))
    return 0 if result.arrived else 1


def job_of(flags: Trace) -> Task:
    """The contour of the catalogue or of a file; its feeds are not used.

    Raises:
        ValueError: no such contour, or a bad file.
    """
    pace = Pace.of(MachineFlags(feed_mm_per_min=3000.0), machine_named(flags.plant))
    return job_named(flags.contour, pace)


def of_file(job: Task, machine: Machine, name: str) -> dict[str, Any]:
    """Fields of the result about the file behind a contour."""
    if not isinstance(job, Job) or job.program is None or job.program.read is None:
        return {}
    dt, program = machine.model.dt, job.program.read
    path = np.asarray(job.reference(dt, 0).position)[: job.samples]
    # doubts of the motion, which is not this one, are left out
    read = replace(read_of(job, path, dt), duration=None, doubts=program.doubts)
    return {"read": read, "axes": machine.axes, "lost": not_kept(program, name)}


def not_kept(read: Toolpath, name: str) -> str:
    """What of a file a controller of its own speed does not keep, in words."""
    waits = bool(np.nansum(read.rest) > 0 or read.z_alone.any())
    lost = {
        "feeds": Path(name).suffix.lower() not in (".csv", *DRAWINGS),
        "stops": any(stop.after for stop in read.asks),
        "waits": waits,
        "rapid moves": bool(read.rapid.any()),
    }
    words = [word for word, there in lost.items() if there]
    if not words:
        return ""
    told = " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
    path = "; rapid moves are part of the path" if lost["rapid moves"] else ""
    return f"The controller chooses its own speed: {told} of the file are not kept{path}."


def _ran(
    asked: Traverser, controller: Held, reference: Reference, flags: Trace
) -> tuple[HostRun, str]:
    fallback = None if flags.fallback == "stop" else flags.fallback
    try:
        return reported_loop(asked.hosted.plant, controller, reference, fallback=fallback), ""
    except Stopped as stopped:
        return stopped.run, str(stopped)


def _result(flags: Trace, asked: Traverser, run: HostRun, failure: str) -> Traversed:
    report, rollout = run.report, run.rollout
    found = Traversed(
        plant=flags.plant,
        contour=flags.contour,
        control_unit=asked.machine.control_unit,
        length_mm=1e3 * float(asked.contour.length),
        failure=failure,
        steps=len(report.residual),
        fallbacks=report.fallbacks,
        limited=report.active_fraction,
        residual=report.worst_residual,
        arrived=False,
        time_s=None,
    )
    if len(rollout.output) == 0:
        return found
    limit = control_limit(asked.machine, flags.max_control)
    used = np.abs(rollout.control).max(axis=0)
    limits = tuple(np.broadcast_to(limit, used.shape).tolist())
    drives = replace(found, control_used=tuple(used.tolist()), control_limit=limits)
    return _scored(drives, asked, run)


def _scored(found: Traversed, asked: Traverser, run: HostRun) -> Traversed:
    """The result with errors and signals."""
    mpcc, memory, output = asked.mpcc, run.rollout.memory.inner, run.rollout.output
    score = traversal_score(asked.contour, output, asked.hosted.plant.dt, progress=mpcc.arc(memory))
    signals = Signals(
        arc_mm=1e3 * score.arc,
        contour_error_um=1e6 * score.error,
        speed_mm_s=1e3 * mpcc.speed(memory),
        tool_mm=1e3 * np.asarray(output),
        control=np.asarray(run.rollout.control),
    )
    return replace(found, signals=signals, **judged(score, output, asked.contour, found.failure))


def judged(score: Score, output: ArrayLike, contour: Contour, failure: str = "") -> dict[str, Any]:
    """Fields of the result: whether the tool arrived, how far it came, and its errors.

    Args:
        score: of the run.
        output: tool points [m], all samples.
        contour: the path.
        failure: why the run stopped; empty when it went through.
    """
    length = float(contour.length)
    through = bool(np.isfinite(score.time))
    apart = float(np.linalg.norm(np.asarray(output)[-1] - np.asarray(contour.position(length))))
    arrived = through and apart <= AT_END and not failure
    return {
        "arrived": arrived,
        "time_s": score.time if arrived else None,
        "came_mm": 1e3 * float(np.clip(score.arc.max(), 0.0, length)),
        "end_mm": 1e3 * apart,
        "rms_um": 1e6 * score.rms if through else None,
        "peak_um": 1e6 * score.peak if through else None,
    }


def _signals(drawn: Drawn):
    result = drawn.result
    title = f"{result.contour} on {result.plant}: model predictive contouring control"
    return signals_figure(result.signals, result.control_unit, title)


def _path(drawn: Drawn):
    result = drawn.result
    return path_figure(result.signals, drawn.foot_mm, f"{result.contour} on {result.plant}")


def show(result: Traversed, console: Console) -> None:
    """How long, how far off, and whether the limits or the solver had a say."""
    time = "none: the tool DID NOT ARRIVE at the end of the path"
    if result.arrived:
        time = f"{tables.digits(result.time_s)} s, up to {1e3 * END_MARGIN:g} mm before the end"
    lines = [
        f"{result.contour}: {result.length_mm:.4g} mm on {result.plant}, {result.steps} samples",
        *_told_of_file(result),
        f"Traversal time    {time}",
        *_told_of_end(result),
    ]
    limited = f"{100 * result.limited:.4g} % of the steps; fallback steps: {result.fallbacks}"
    lines.append(f"Limits in plan    {limited}")
    residual = f"{result.residual:.1e} of a QP (at most 1e-8 counts as solved)"
    lines.append(f"Worst residual    {residual}")
    if result.failure:
        lines.append(f"STOPPED: {result.failure}")
    tables.say(console, *lines)


def _told_of_end(result: Traversed) -> list[str]:
    """How far the tool came, and how far off it was on the way and at the last sample."""
    if result.end_mm is None:
        return []
    errors = "none: it counts on the whole path"
    if result.rms_um is not None:
        errors = f"RMS {result.rms_um:.4g} um, peak {result.peak_um:.4g} um"
    came = f"{_shown(result.came_mm)} mm of {result.length_mm:.4g} mm along the path"
    apart = f"{_shown(result.end_mm)} mm from its end point at the last sample"
    return [
        f"Tool came         {came}; {apart}",
        f"Contour error     {errors}",
    ]


def _told_of_file(result: Traversed) -> list[str]:
    """What was read, and what of it is not kept."""
    if result.read is None:
        return []
    name = Path(result.contour).stem
    return [
        f"Read {tables.read_line(name, result.read, result.axes)}",
        *filter(None, [result.lost]),
    ]


def _next(result: Traversed) -> list[str]:
    """Figures in words, and the next step."""
    told = []
    if result.signals is not None:
        told.append(
            "path.png shows the tool around the path, its error magnified, and the speed there; "
            "trace.png the signals along the path."
        )
    if result.failure:
        return [*told, "Next: --fallback hold goes on where a step has no answer."]
    if not result.arrived:
        return [*told, f"Next: {advice(result)}."]
    return [*told, "Next: --q-theta trades time for accuracy: more is faster, less is closer."]


def _shown(length_mm: float | None) -> str:
    """A length in digits down to a nanometre; rounding is none."""
    return f"{round(length_mm or 0.0, 6):.4g}"


def advice(result: Traversed) -> str:
    """What may bring a tool to the end that did not arrive, in words."""
    if result.rms_um is not None:  # it was there, and does not stay
        return (
            "a longer --horizon brakes in time, less --q-theta is slower; more --q-contour and "
            "--q-lag hold the tool closer"
        )
    shares = np.divide(result.control_used, result.control_limit)
    progress, most = "more --q-theta rewards progress", int(np.argmax(shares))
    if shares[most] >= FULL:
        return f"{progress}, a larger --max-control allows it"
    used, limit = (tables.digits(of[most]) for of in (result.control_used, result.control_limit))
    return (
        f"{progress}, a longer --horizon sees more of it, less --r-control lets the controls "
        f"change faster: they used at most {used} of {limit} {result.control_unit}"
    )
