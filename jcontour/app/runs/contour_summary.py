"""Summaries of a contour, its motion and its runs, for tables and figures."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import (
    ContourRead,
    FamilyMetrics,
    MachineSummary,
    MotionSummary,
    PeakPlace,
    RunMetrics,
)
from jcontour.app.jobs.job import Job, Task
from jcontour.app.jobs.replays import Replay, Scenarios, desired, scored
from jcontour.app.machines.machine import Machine
from jcontour.app.reports.figures.contours import NOMINAL, ContourRuns, DrawnRun
from jcontour.geometry.contour import outline, unpadded

if TYPE_CHECKING:
    from jcontour.motion.cornering import Planned


class Simulated(NamedTuple):
    """Runs of one contour with their signals, and what is stored of them."""

    result: SimulatedResult
    scenarios: Scenarios
    replay: Replay


SAID = ("ignored", "warnings", "stops")  # of a program
LARGEST = {"rms": "largest RMS", "peak": "largest error"}  # what makes a plant the worst one


def machine_summary(machine: Machine) -> MachineSummary:
    """Name, axes and units of a machine."""
    return MachineSummary(
        machine.name, machine.control_unit, machine.axes, machine.nonsmooth_effects
    )


def loop_summary(machine: Machine, controller: str) -> dict[str, Any]:
    """Fields of every result of a controller on a machine."""
    return {
        "machine": machine_summary(machine),
        "controller": controller,
        "error": machine.error,
    }


def family_metrics(replay: Replay, index: int) -> FamilyMetrics:
    """Metrics on one contour: the nominal plant, and the worst of the family metric by metric."""
    return FamilyMetrics(
        nominal=RunMetrics.of(replay.metrics, lambda values: values[index, 0]),
        worst=RunMetrics.of(replay.metrics, lambda values: values[index].max()),
    )


def read_of(job: Task, dt: float) -> ContourRead:
    """Size of a contour and of the run along it in samples of a period [s].

    The box is that of the contour as programmed: the motion may leave it in blended corners.
    """
    # How far a run at constant feed goes, and its entry: whole laps where so to within a sample
    way, entry = None, 0.0
    if isinstance(job, Job) and not job.at_rest:
        arc, length = job.arc - job.arc[0], float(job.contour.length)
        ways = np.array([arc[-1], arc[np.argmax(job.scored)]])
        laps = np.rint(ways / length) * length
        way, entry = np.where((laps > 0) & (np.abs(ways - laps) <= arc[1]), laps, ways).tolist()
    box, program = outline(job.contour), job.program
    said = {} if program is None else {name: getattr(program, name) for name in SAID}
    return ContourRead(
        pieces=int(np.sum(job.contour.mask)),
        length=float(job.contour.length),
        duration=_duration(job, dt),
        low=tuple(box.min(axis=0).tolist()),
        high=tuple(box.max(axis=0).tolist()),
        **said,
        rapid_length=rapid_length(job),
        way=way,
        entry=entry,
    )


def cycle_time(job: Task, dt: float) -> float:
    """Time of a run [s]; of one lap where it goes around its path more than once."""
    laps = np.ptp(job.arc) / float(job.contour.length) if isinstance(job, Job) else 1.0
    return _duration(job, dt) / max(1.0, float(laps))


def run_outline(job: Task, dt: float, plants: int, doing: str) -> str:
    """A line about a run in steps, before it begins: its time [s], its samples, what is done."""
    lasting = dt * (job.samples - 1)
    time = f"{lasting:,.0f}" if lasting >= 10 else f"{lasting:.2g}"
    size = f"{time} s of motion, {job.samples:,} samples on {plants} plants"
    return f"{job.name}: {size}: {doing}; Ctrl-C ends it."


def _duration(job: Task, dt: float) -> float:
    """Time of a run [s]: that of its planned motion, else from its first sample to its last."""
    if isinstance(job, Job) and job.planned is not None:
        return job.planned.duration
    return float((job.samples - 1) * dt)


def rapid_length(job: Task) -> float:
    """Length of the rapid moves of a run [m]."""
    if not isinstance(job, Job):
        return 0.0
    return float(unpadded(job.contour).extent[job.rapid].sum())


def peak_place(scenarios: Scenarios, replay: Replay, index: int, error: str) -> PeakPlace | None:
    """Place of the largest error over all plants that follow the contour; None where none does.

    `error` is the one that counts, "contour" or "tracking".
    """
    path = desired(scenarios)[index]
    vectors = replay.contour_error[index]
    if error == "tracking":
        vectors = replay.output[index] - path
    size = np.linalg.norm(vectors, axis=-1)  # (plant, time)
    lost = np.asarray(replay.metrics.diverged)[index]
    size = np.where(scored(scenarios)[index] & ~lost[:, None], size, -1.0)
    plant, sample = np.unravel_index(np.argmax(size), size.shape)
    if size[plant, sample] < 0:
        return None
    return PeakPlace(
        plant=scenarios.plants[plant],
        error=float(size[plant, sample]),
        time=float(sample * scenarios.references.dt),
        position=tuple(path[sample].tolist()),
        line=scenarios.jobs[index].line_at(int(sample)),
    )


def motion_summary(planned: "Planned") -> MotionSummary:
    """Cycle time, shares of it under every limit, and peaks."""
    from jcontour.motion.cornering import limit_shares

    motion = planned.motion
    begin = motion.nodes[:-1]
    middle = begin + 0.5 * np.diff(motion.nodes)
    _, acceleration, jerk = motion.axes_at(middle)
    _, *first = motion.axes_at(begin)
    peak_acceleration, peak_jerk = (
        np.abs(np.concatenate(both)).max(axis=0)
        for both in zip(first, (acceleration, jerk), strict=True)
    )
    return MotionSummary(
        cycle_time=planned.duration,
        stops=motion.stops.size - 2,
        deviation=planned.around.deviation,
        shares=limit_shares(planned),
        jerk_limit=tuple(motion.limits.jerk.tolist()),
        peak_jerk=tuple(peak_jerk.tolist()),
        peak_acceleration=tuple(peak_acceleration.tolist()),
        gap=motion.gap,
        dwell=planned.rests.total,
    )


def contour_runs(
    replays: Mapping[str, Replay], scenarios: Scenarios, index: int, machine: Machine
) -> ContourRuns:
    """Runs along one contour: a row on the nominal plant, a row on every label's worst plant.

    Of one label alone that is the plant with the largest error, whose place is printed; several are
    compared by their RMS errors.
    """
    by = "peak" if len(replays) == 1 else "rms"
    steps, rows = scenarios.jobs[index].steps, ([], [])
    for label, one in replays.items():
        # The largest error; the first plant that diverges, where one does
        values = np.asarray(getattr(one.metrics, f"{by}_{machine.error}_error"))[index]
        lost = np.asarray(one.metrics.diverged)[index]
        worst = int(np.argmax(np.where(lost, np.inf, values)))
        named = (0, NOMINAL), (worst, f"{LARGEST[by]} ({scenarios.plants[worst]})")
        for row, (plant, words) in zip(rows, named, strict=True):
            run = DrawnRun(
                label=label,
                plant=words,
                output=one.output[index, plant, :steps],
                control=one.control[index, plant, :steps],
                contour_error=one.contour_error[index, plant, :steps],
                diverged=bool(lost[plant]),
            )
            row.append(run)
    return ContourRuns(
        name=scenarios.jobs[index].name,
        time=scenarios.references.dt * np.arange(steps),
        scored=scored(scenarios)[index, :steps],
        reference=desired(scenarios)[index, :steps],
        axes=machine.axes,
        control_unit=machine.control_unit,
        rows=tuple(map(tuple, rows if len(scenarios.plants) > 1 else rows[:1])),
    )
