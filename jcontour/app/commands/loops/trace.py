"""`jcontour trace`: model predictive contouring control, which chooses its own speed."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import ArrayLike
from rich.console import Console

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.designs.predictive.constrained import (
    CHANGE,
    LONGEST_HORIZON,
    Traverser,
    control_limit,
    traverser,
    waiting_reference,
)
from jcontour.app.files.results.loop_results import Asked, Signals, Traversed
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import LimitCheck, Verdict, exceeded, kept_words, reason
from jcontour.app.flags.loops import Trace
from jcontour.app.flags.shared import MachineFlags
from jcontour.app.jobs.job import Job, Pace, Task
from jcontour.app.machines.machine import Machine
from jcontour.app.reports import tables
from jcontour.app.reports.figures.loops import path_figure, signals_figure
from jcontour.app.reports.figures.png import save_figure
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.checks.machine_limits import Signals as Seen
from jcontour.app.runs.checks.machine_limits import limits_of_groups
from jcontour.app.runs.contour_summary import read_of
from jcontour.app.runs.lifecycle import created, finished
from jcontour.geometry.contour import Contour
from jcontour.geometry.drawings.reading import SUFFIXES as DRAWINGS
from jcontour.geometry.outlines import outline
from jcontour.geometry.toolpaths import Toolpath
from jcontour.host.loop import HostRun, Stopped, reported_loop
from jcontour.mpc.contouring.mpcc import ARRIVAL
from jcontour.simulation.traversal import END_MARGIN, Score, outrun, traversal_score

# [m] from the end at the last sample: the controller ends a run once it has measured the tool
# within ARRIVAL, and the tool moves on for up to two of its periods until it acts on that
AT_END = 10 * ARRIVAL
AHEAD_MS = 28.0  # that the paper's 7 steps of 4 ms look ahead
LEAST, MOST = 0.03, 5.0  # q_theta, the paper's range
FULL = 0.9  # of its limit: a control that has come so far is short of it


def command(flags: Trace) -> int:
    """The whole command; exit code."""
    machine, job = machine_named(flags.plant), job_of(flags)
    asked = traverser(machine, job.contour, flags)
    reference, controller = waiting_reference(asked), asked.controller
    controller.initial_memory(reference)  # raises what does not fit before anything is written
    folder = created(flags, "trace")
    fallback, failure = None if flags.fallback == "stop" else flags.fallback, ""
    with tables.console_of(quiet=flags.json).status("solving a QP at every step"):
        try:
            run = reported_loop(asked.hosted.plant, controller, reference, fallback=fallback)
        except Stopped as stopped:
            run, failure = stopped.run, str(stopped)
    result = replace(_result(flags, asked, run, failure), **of_file(job, machine, flags.contour))
    verdict = verdict_on(result)
    result = replace(result, verdict=verdict)
    if result.signals is not None:
        title = f"{result.contour} on {result.plant}"
        about = f"{title}: model predictive contouring control"
        figure = signals_figure(result.signals, result.control_unit, about)
        save_figure(figure, folder / "trace.png")
        foot = 1e3 * np.asarray(asked.contour.position(1e-3 * result.signals.arc_mm))
        path = path_figure(result.signals, 1e3 * outline(asked.contour), foot, title)
        save_figure(path, folder / "path.png")
    write_result(folder, result)
    answer = [Entry("Run", line) for line in _lines(result)]
    return finished(folder, result, flags, show, [*answer, *next_steps(result)], verdict)


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
    # time and doubts of the motion, which is not this one, are left out
    read = replace(read_of(job, dt), duration=None, doubts=program.doubts)
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


def _result(flags: Trace, asked: Traverser, run: HostRun, failure: str) -> Traversed:
    """Numbers of a run; errors and signals where there is a sample of it."""
    report, rollout, mpcc = run.report, run.rollout, asked.mpcc
    result = Traversed(
        plant=flags.plant,
        contour=flags.contour,
        control_unit=asked.machine.control_unit,
        length_mm=1e3 * float(asked.contour.length),
        asked=Asked(
            q_theta=mpcc.weights.progress,
            q_lag=mpcc.weights.lag,
            r_control=tuple(np.diag(mpcc.weights.control_matrix(mpcc.model.inputs)).tolist()),
            horizon=int(mpcc.blocks.sum()),
            period_ms=1e3 * mpcc.model.dt,
            max_speed_mm_s=1e3 * asked.speed_limit,
        ),
        failure=failure,
        steps=len(report.residual),
        fallbacks=report.fallbacks,
        limited=report.active_fraction,
        residual=report.worst_residual,
        arrived=False,
        time_s=None,
    )
    output, control = np.asarray(rollout.output), np.asarray(rollout.control)
    if len(output) == 0:
        return result
    used, memory = np.abs(control).max(axis=0), rollout.memory.inner
    limit = np.broadcast_to(control_limit(asked.machine, flags.max_control), used.shape)
    score = traversal_score(asked.contour, output, asked.hosted.plant.dt)
    return replace(
        result,
        control_used=tuple(used.tolist()),
        control_limit=tuple(limit.tolist()),
        signals=Signals(
            arc_mm=1e3 * score.arc,
            contour_error_um=1e6 * score.error,
            speed_mm_s=1e3 * mpcc.speed(memory),
            tool_mm=1e3 * output,
            control=control,
        ),
        limits=limits_along(flags.contour, output, control, asked.machine),
        **judged(score, output, asked.contour, mpcc.arc(memory), failure),
    )


def limits_along(
    contour: str, output: np.ndarray, control: np.ndarray, machine: Machine
) -> list[LimitCheck]:
    """Every limit of the machine with what a run reaches.

    Args:
        contour: name.
        output: (T, m) tool [m].
        control: (T, p).
        machine: with its limits.
    """
    counted = np.ones((1, len(output)), bool)
    seen = Seen(output[None, None], control[None, None], counted, [contour], ["nominal"])
    return limits_of_groups(seen, machine, np.ones(1, bool))


def judged(
    score: Score, output: ArrayLike, contour: Contour, progress: ArrayLike, failure: str = ""
) -> dict[str, Any]:
    """Fields of the result: whether the tool arrived, how far it came, and its errors.

    A tool that was ever farther from the path than this is large has left it: it comes no further.

    Args:
        score: of the run.
        output: tool points [m], all samples.
        contour: the path.
        progress: (T,) where the controller held the tool to be along it [m].
        failure: why the run stopped; empty when it went through.
    """
    length, away = float(contour.length), ~(score.error <= float(contour.size))
    left = bool(away.any())
    on_it = score.arc[: int(np.argmax(away))] if left else score.arc
    through = bool(np.isfinite(score.time)) and not left
    apart = float(np.linalg.norm(np.asarray(output)[-1] - np.asarray(contour.position(length))))
    arrived = through and apart <= AT_END and not failure
    return {
        "arrived": arrived,
        "time_s": score.time if arrived else None,
        "came_mm": 1e3 * float(np.clip(on_it.max(initial=0.0), 0.0, length)),
        "progress_mm": 1e3 * float(np.asarray(progress)[-1]),
        "outrun": outrun(contour, score, progress),
        "left_mm": 1e3 * float(score.error.max()) if left else None,
        "end_mm": 1e3 * apart,
        "rms_um": 1e6 * score.rms if through else None,
        "peak_um": 1e6 * score.peak if through else None,
    }


def show(result: Traversed, console: Console) -> None:
    """How long, how far off, and whether the limits or the solver had a say."""
    tables.say(console, *_lines(result))


def _lines(result: Traversed) -> list[str]:
    length = f"{result.length_mm:.4g} mm"
    lines = [f"{result.contour}: {length} on {result.plant}, {result.steps} samples"]
    if result.read is not None:
        name = Path(result.contour).stem
        lines.append(f"Read {tables.read_line(name, result.read, result.axes)}")
        lines += filter(None, [result.lost])
    time = "none: the tool DID NOT ARRIVE at the end of the path"
    if result.arrived:
        time = f"{tables.digits(result.time_s)} s, up to {1e3 * END_MARGIN:g} mm before the end"
    lines.append(f"Traversal time    {time}")
    if result.end_mm is not None:
        errors = "none: it counts on the whole path"
        if result.rms_um is not None:
            errors = f"RMS {result.rms_um:.4g} um, peak {result.peak_um:.4g} um"
        came = f"{_shown(result.came_mm)} mm of {length} along the path"
        apart = f"{_shown(result.end_mm)} mm from its end point at the last sample"
        lines += [f"Tool came         {came}; {apart}", f"Contour error     {errors}"]
    return [
        *lines,
        f"Limits in plan    {100 * result.limited:.4g} % of the steps; "
        f"fallback steps: {result.fallbacks}",
        f"Worst residual    {result.residual:.1e} of a QP (at most 1e-8 counts as solved)",
    ]


def verdict_on(result: Traversed) -> Verdict:
    """Verdict on a run: the tool arrives at the end, within every limit of the machine."""
    length = f"{result.length_mm:.4g} mm"
    against = [reason(f"it stopped: {result.failure}")] if result.failure else []
    if result.left_mm is not None:
        off = f"{_shown(result.left_mm)} mm"
        against.append(reason(f"the tool LEFT the path: it was {off} off one of {length}"))
    elif result.outrun:
        came = f"{_shown(result.progress_mm)} mm of {length}, the tool {_shown(result.came_mm)} mm"
        outrun = f"the controller's progress LEFT THE TOOL BEHIND: it came to {came}"
        against.append(reason(outrun))
    if not result.arrived and not against:
        against.append(reason("the tool did not arrive at the end of the path"))
    return Verdict.of(result.limits, against, passed=kept_words(result.limits))


def _shown(length_mm: float | None) -> str:
    """A length in digits down to a nanometre; rounding is none."""
    return f"{round(length_mm or 0.0, 6):.4g}"


def next_steps(result: Traversed) -> list[Entry]:
    """The next step."""
    if result.failure:
        step = "--fallback hold goes on where a step has no answer."
    elif not result.arrived:
        step = f"{advice(result)}."
    elif exceeded(result.limits):
        lower = f"--max-speed-mm-s, {tables.digits(0.5 * result.asked.max_speed_mm_s)} say"
        known = "of the machine's limits the controller knows that of the control"
        step = f"a lower {lower}, or less --q-theta asks less of it: {known}."
    else:
        step = "--q-theta trades time for accuracy: more is faster, less is closer."
    return [Entry("Next", step)]


def advice(result: Traversed) -> str:
    """What may bring a tool to the end that did not arrive, in words.

    A longer horizon looks as far ahead in time as the paper's, or twice as far as now.
    """
    asked = result.asked
    less = f"less --q-theta, {tables.digits(0.1 * asked.q_theta)} say"
    paper = int(np.ceil(AHEAD_MS / asked.period_ms - 1e-9))
    steps = paper if asked.horizon < paper else 2 * asked.horizon
    horizon = f"--horizon {min(LONGEST_HORIZON, steps)}"
    near = asked.horizon * asked.period_ms < AHEAD_MS
    if result.outrun or result.left_mm is not None:  # progress and tool have to stay together
        ways = []
        if asked.q_lag < Trace.q_lag:
            ways.append(f"--q-lag {Trace.q_lag:g} ties progress to the tool")
        if near:
            ways.append(f"{horizon} looks {AHEAD_MS:g} ms ahead, as in the paper")
        if not ways or asked.q_theta > MOST:
            ways.append(f"{less}, rewards progress less than it costs")
        return "; ".join(ways)
    if result.rms_um is not None:  # it was there, and does not stay
        return (
            f"{horizon} brakes in time, {less}, is slower; more --q-contour and --q-lag hold the "
            "tool closer"
        )
    if asked.q_theta < LEAST:
        return f"more --q-theta rewards progress, {Trace.q_theta:g} say"
    shares = np.divide(result.control_used, result.control_limit)
    most = int(np.argmax(shares))
    if shares[most] >= FULL:
        return "a larger --max-control allows it"
    used, limit = (tables.digits(of[most]) for of in (result.control_used, result.control_limit))
    weight, usual = asked.r_control[most], CHANGE / result.control_limit[most] ** 2
    lower = tables.digits(usual if weight > 1.01 * usual else 0.1 * weight)
    sight = f", {horizon} sees more of it" if near else ""
    return (
        f"less --r-control, {lower} say, lets the controls change faster{sight}: they used at most "
        f"{used} of {limit} {result.control_unit}"
    )
