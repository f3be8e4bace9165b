"""One run of predictive control, with a quadratic program at every sample, as `simulate` shows it.

MPCC chooses its own speed: the tool is compared with the nearest point of the path.
"""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour.app.catalogue.choices import set_of
from jcontour.app.designs.design import given
from jcontour.app.designs.predictive import (
    LONGEST_HORIZON,
    PREDICTIVE,
    HostedRun,
    PredictiveDesign,
    speed_limit,
)
from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import RunMetrics
from jcontour.app.files.results.verdict import Verdict, kept_words, reason, warning
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Job, Task
from jcontour.app.jobs.replays import Scenarios, replayed
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import feed_words, named_numbers
from jcontour.app.runs.checks.machine_limits import machine_limits, peak_controls
from jcontour.app.runs.contour_summary import Simulated, loop_summary, peak_place, read_of
from jcontour.geometry.contour import Contour
from jcontour.geometry.toolpath_rules import DRAWINGS
from jcontour.geometry.toolpaths import Toolpath
from jcontour.host.loop import HostRun, Stopped, reported_loop
from jcontour.motion.references import along
from jcontour.mpc.contouring.mpcc import ARRIVAL
from jcontour.simulation.evaluation import stack_plants, stack_references
from jcontour.simulation.traversal import Score, outrun, traversal_score

# [m] from the end at the last sample: the controller ends a run once it has measured the tool
# within ARRIVAL, and the tool moves on for up to two of its periods until it acts on that
AT_END = 10 * ARRIVAL


class Ending(StrEnum):
    """How a run ended."""

    ARRIVED = "arrived"
    LATE = "late"  # its tool had not arrived when the time was up
    OUTRUN = "outrun"  # the controller's progress came to the end of the path, its tool did not
    UNSOLVED = "unsolved"  # a quadratic program had no answer
    DIVERGED = "diverged"  # not finite, or farther from the path than this is large


LOST = {  # how a run did not end well -> what is said, and what may help
    Ending.LATE: (
        "the tool is not at the end of the path at the last sample",
        "more --weights q_theta=..., or a longer --preview that brakes in time",
    ),
    Ending.OUTRUN: (
        "the controller's progress came to the end of the path and LEFT THE TOOL BEHIND",
        "less --weights q_theta=..., or more q_lag",
    ),
    Ending.DIVERGED: (
        "the tool LEFT the path, by more than this is large",
        "less --weights q_theta=..., or a longer --preview",
    ),
    Ending.UNSOLVED: ("a quadratic program had no answer", "a lower --feed-mm-per-min"),
}


def traversed(flags: Simulate, machine: Machine, job: Task) -> Simulated:
    """Run the controller of the flags along a contour."""
    assert flags.controller is not None
    unread = [name for name in set_of(flags) if name != "preview"]
    if unread:
        name = unread[0].replace("_", "-")
        raise ValueError(f"{name}: {flags.controller} has no use for it; leave it out")
    kind = PREDICTIVE[flags.controller]
    weights = {
        name: value[0] for name, value in (named_numbers("weights", w) for w in given(flags))
    }
    for name in weights:
        if name not in kind.weights:
            known = ", ".join(kind.weights)
            raise ValueError(f"weights: {flags.controller} has no weight {name!r}; it has {known}")
    feed = flags.feed_mm_per_min
    speed = round(kind.share * 1e3 * speed_limit(machine), 6) if feed is None else feed / 60
    horizon = flags.horizon(machine.model.dt)
    if flags.preview is None:
        horizon = min(horizon, LONGEST_HORIZON)
    design = PredictiveDesign(weights, horizon, speed)
    hosted, failure = kind.hosted(machine, job.contour, design), ""
    hosted.controller.initial_memory(hosted.reference)  # raises what does not fit
    try:
        run = reported_loop(hosted.plant, hosted.controller, hosted.reference)
    except Stopped as stopped:
        run, failure = stopped.run, str(stopped)
    output, control = np.asarray(run.rollout.output), np.asarray(run.rollout.control)
    if len(output) < 2:
        raise ValueError(f"{flags.controller}: {failure}")
    ending, score = ended(run, hosted, job.contour)
    if failure:
        ending = Ending.UNSOLVED
    elif ending is Ending.ARRIVED and not stays(output[-1], job.contour):
        ending = Ending.LATE
    arc = np.zeros(len(output)) if score is None else np.maximum.accumulate(score.arc)
    reference = along(job.contour, arc, hosted.plant.dt, 0, at_rest=True)
    references = stack_references([reference])
    if isinstance(job, Job):  # its samples are those of the run
        job = job._replace(arc=arc, scored=np.ones(len(arc), bool), planned=None, settling=0)
    scenarios = Scenarios((job,), (False,), ("nominal",), references, stack_plants([hosted.plant]))
    replay = replayed(output[None, None], control[None, None], references)
    lost = np.full((1, 1), ending is Ending.DIVERGED)
    replay = replay._replace(
        metrics=replace(replay.metrics, diverged=lost | replay.metrics.diverged)
    )
    messages = []
    if ending is not Ending.ARRIVED:
        words, helps = LOST[ending]
        messages.append(reason(f"{words}{': ' if failure else ''}{failure}", helps))
    if isinstance(job, Job) and job.program is not None:
        messages += [warning(line) for line in not_kept(job.program, flags.contour or "")]
    read = read_of(job, hosted.plant.dt)
    time = None  # until the tool has arrived [s]
    lost_ones = (Ending.DIVERGED, Ending.UNSOLVED)
    if score is not None and ending not in lost_ones and np.isfinite(score.time):
        time = float(score.time)
    limits = machine_limits(replay, scenarios, machine)
    result = SimulatedResult(
        **loop_summary(machine, flags.controller),
        weights={**weights},
        contour=job.name,
        feed_law=f"at most {feed_words(1e-3 * design.speed_mm_s)}",
        samples=len(output),
        preview=design.horizon,
        plants={"nominal": RunMetrics.of(replay.metrics, lambda values: values[0, 0])},
        read=replace(read, duration=time),  # that of the run, not of the motion as programmed
        peak=peak_place(scenarios, replay, 0, machine.error),
        peak_controls=peak_controls(replay, scenarios),
        verdict=Verdict.of(limits, messages, passed=kept_words(limits)),
        sample_period=float(hosted.plant.dt),
    )
    return Simulated(result, scenarios, replay)


def ended(run: HostRun, hosted: HostedRun, contour: Contour) -> tuple[Ending, Score | None]:
    """How a run whose programs were solved ended, and its score; None where it is not finite."""
    rollout = run.rollout
    output, control = np.asarray(rollout.output), np.asarray(rollout.control)
    if not (np.isfinite(output).all() and np.isfinite(control).all()):
        return Ending.DIVERGED, None
    score = traversal_score(contour, output, hosted.plant.dt)
    if not score.peak <= float(contour.size):
        return Ending.DIVERGED, score
    if hosted.progress is not None and outrun(contour, score, hosted.progress(rollout.memory)):
        return Ending.OUTRUN, score
    return Ending.ARRIVED if np.isfinite(score.time) else Ending.LATE, score


def stays(tool: Float[np.ndarray, " m"], contour: Contour) -> bool:
    """Whether the tool is at the end of the path at its last sample."""
    end = np.asarray(contour.position(contour.length))
    return bool(np.linalg.norm(tool - end) <= AT_END)


def not_kept(read: Toolpath, name: str) -> list[str]:
    """What of a file a controller of its own speed does not keep, in words."""
    waits = bool(np.nansum(read.rest) > 0 or read.z_alone.any())
    lost = {
        "feeds": Path(name).suffix.lower() not in (".csv", *DRAWINGS),
        "stops": any(stop.after for stop in read.asks),
        "waits": waits,
        "rapid moves": bool(read.rapid.any()),
    }
    words = ", ".join(word for word, there in lost.items() if there)
    path = "; rapid moves are part of the path" if lost["rapid moves"] else ""
    return [f"its speed is that of the controller: {words} of the file are not kept{path}"] * bool(
        words
    )
