"""Checks of runs beside their limits: arrival, motion between samples, NaN, the plan itself."""

from collections.abc import Iterator

import numpy as np

from jcontour.app.files.checks import LARGEST
from jcontour.app.files.results.verdict import Message, warning
from jcontour.app.jobs.job import Job, Task
from jcontour.app.jobs.replays import Replay, Scenarios, desired, measured_speeds, scored
from jcontour.app.machines.machine import Machine
from jcontour.app.runs.checks.machine_limits import between_counted
from jcontour.simulation.limit_use import alternating

RESTS = 0.05  # of the largest step of a motion: the last one, where it ends at rest
FAR = 2.0  # largest contour errors that the tool may be from the end
FOLLOWED = 0.5  # of the length of a motion, that the tool needs to move
MUCH = 0.2  # of the RMS error, from which on a swing is reported
PARABOLA = np.sqrt(8 / 15)  # RMS of an arc of it over its height
LEAST = 1e-9  # error [m], below which nothing is measured
SOUGHT = "look for 0 / 0, inf - inf, and roots and logarithms of negative numbers in"
NAN = "is NaN (not a number)"
PLACES = {"output": "the plant", "control": "the controller and in what it measures"}
ROUNDING = 1 + 1e-4  # of a limit: positions are rounded, and their differences more
ALIKE = 1 - 1e-9  # rounding chooses none of these
QUANTITIES = (("speed", "m/s"), ("acceleration", "m/s^2"))


def motions_not_followed(replay: Replay, scenarios: Scenarios) -> list[str]:
    """A line for every contour along which the tool of a plant moves less than `FOLLOWED` of it."""
    lines = []
    for c, points in enumerate(desired(scenarios)):
        count = scenarios.jobs[c].samples
        asked = _length(points[:count])
        moved = _length(replay.output[c, :, :count])
        worst = int(np.nanargmin(np.append(moved, np.inf)))
        if worst < moved.size and moved[worst] < FOLLOWED * asked:
            lines.append(
                f"the tool moves {round(1e3 * moved[worst], 6):.4g} of {1e3 * asked:.4g} mm "
                f"({scenarios.jobs[c].name}, {scenarios.plants[worst]}): it does not follow"
            )
    return lines


def _length(points: np.ndarray) -> np.ndarray:
    """Length of motions, (..., time, axis), from sample to sample [m]."""
    with np.errstate(over="ignore", invalid="ignore"):  # of runs that diverge
        return np.linalg.norm(np.diff(points, axis=-2), axis=-1).sum(axis=-1)


def arrival_warnings(replay: Replay, scenarios: Scenarios) -> list[str]:
    """A line for the contour at whose last sample the tool is farthest from its end.

    There is one where that is more than `FAR` of the largest contour errors that were scored, of a
    motion that ends at rest in a cut: the tool has not settled then.
    """
    lost = np.asarray(replay.metrics.diverged)
    peaks = np.asarray(replay.metrics.peak_contour_error)
    late = []
    for c, (job, points, counted) in enumerate(
        zip(scenarios.jobs, desired(scenarios), scored(scenarios), strict=True)
    ):
        steps = np.linalg.norm(np.diff(points[: job.samples], axis=0), axis=1)
        last = job.steps - 1
        if not counted[last] or steps[-1:].sum() > RESTS * steps.max(initial=0.0):
            continue
        apart = np.linalg.norm(replay.output[c, :, last] - points[last], axis=1)
        apart = np.where(lost[c], 0.0, apart)
        worst = int(np.argmax(apart))
        if apart[worst] > FAR * np.where(lost[c], 0.0, peaks[c]).max():
            late.append((float(apart[worst]), job.name, scenarios.plants[worst]))
    if not late:
        return []
    distance, name, plant = max(late)
    return [
        f"when the run is over the tool is still {1e6 * distance:.4g} um from its end ({name}, "
        f"{plant}): the loop is slow, or swings; what follows is not scored"
    ]


def swing_warnings(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """A line where the tool swings between samples by much of the error that the samples show.

    Swings within a count of the encoders are not reported.

    An acceleration a that alternates from sample to sample takes the tool a dt^2 / 8 aside, on a
    parabola.
    """
    lost = np.asarray(replay.metrics.diverged)
    control = np.where(lost[..., None, None], 0.0, replay.control)
    aside = alternating(control) @ machine.hidden_acceleration.T * machine.model.dt**2 / 8
    counted = between_counted(scored(scenarios), aside.shape[2])[:, None, :, None]
    squares = np.sum(aside**2, axis=2, where=counted) / np.maximum(counted.sum(axis=2), 1)
    rms = PARABOLA * np.sqrt(squares)
    errors = np.asarray(getattr(replay.metrics, f"rms_{machine.error}_error"))
    most = np.where(counted, aside, 0.0).max(axis=2)
    seen = ~lost[..., None] & (most > (0.0 if machine.resolution is None else machine.resolution))
    shares = np.where(seen, rms / np.maximum(errors, LEAST)[..., None], 0.0)
    place = np.unravel_index(np.argmax(shares), shares.shape)
    if not shares[place] > MUCH:
        return []
    contour, plant, axis = (int(index) for index in place)
    return [
        f"{machine.axes[axis]} swings by {1e6 * rms[place]:.3g} um RMS between samples, and by up "
        f"to {1e6 * most[place]:.3g} um, beside an RMS {machine.error} error of "
        f"{1e6 * errors[contour, plant]:.3g} um at samples ({scenarios.jobs[contour].name}, "
        f"{scenarios.plants[plant]}): its control alternates; a larger rho calms given weights, "
        "--max-rms-increment tuned ones"
    ]


def lost_numbers(replay: Replay, scenarios: Scenarios) -> list[str]:
    """One line where the nominal plant's run on a contour meets NaN out of moderate numbers.

    The output is known before the control of the same sample.
    """
    lines = []
    for k, job in enumerate(scenarios.jobs):
        signals = {"output": replay.output[k, 0], "control": replay.control[k, 0]}
        # Index of the first row with a NaN; their number where there is none
        first = {
            name: int(np.argmax(np.append(np.isnan(rows).any(axis=-1), True)))
            for name, rows in signals.items()
        }
        name = min(first, key=lambda name: first[name])
        sample = first[name]
        before = [np.abs(rows[:sample]) for rows in signals.values()]
        if sample == len(signals[name]) or any(np.any(rows > LARGEST) for rows in before):
            continue
        lines.append(
            f"the {name} {NAN} from sample {sample} ({job.name}, {scenarios.plants[0]}): "
            f"{SOUGHT} {PLACES[name]}"
        )
    return lines


def limits_exceeded_by_plan(scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for a limit of speed, and one for acceleration, that a motion itself exceeds.

    Each tells every axis of the motion that exceeds its limit most, and where. Speed and
    acceleration are differences of the samples, of all of them, in rapid moves as well.
    """
    dt, lines = machine.model.dt, []
    for row, (quantity, unit) in enumerate(QUANTITIES):
        limit = getattr(machine.limits, quantity)
        if limit is None:
            continue
        asked = []
        for job, points in zip(scenarios.jobs, desired(scenarios), strict=True):
            points = points[: job.samples]
            if isinstance(job, Job) and job.at_rest:  # between rests of a sample
                points = np.concatenate([points[:1], points, points[-1:]])
            asked.append(np.abs(measured_speeds(points, dt)[row]))
        job, most = max(
            zip(scenarios.jobs, asked, strict=True),
            key=lambda one: (one[1] / limit).max(initial=0.0),
        )
        if not (most > ROUNDING * limit).any():
            continue
        axes = ", ".join(
            f"{name} {value:.4g} of {allowed:.4g}"
            for name, value, allowed in zip(machine.axes, most.max(axis=0), limit, strict=True)
            if value > ROUNDING * allowed
        )
        keeps = ""  # the flag that keeps the limit
        if isinstance(job, Job) and job.planned is None:
            if not job.at_rest:
                keeps = "; a lower --feed-mm-per-min keeps it"
            elif quantity == "speed":
                keeps = "; --feed-law jerk keeps it"
            else:
                jumps = "in corners a trapezoidal motion jumps in speed"
                keeps = f": {jumps}; --feed-law jerk keeps the limit"
        place = f"{job.name}, {_place(job, most, limit, machine)}"
        lines.append(
            f"{quantity} that the motion itself asks for EXCEEDS the limit: {axes} {unit} "
            f"({place}): the plan does so, not the loop{keeps}"
        )
    return lines


def _place(job: Task, asked: np.ndarray, limit: np.ndarray, machine: Machine) -> str:
    """Axis and sample of the largest excess, of several alike the first."""
    share = asked / limit
    row, axis = np.argwhere(share >= ALIKE * share.max())[0]
    rests = int(isinstance(job, Job) and job.at_rest)
    sample = int(np.clip(row + 1 - rests, 0, job.samples - 1))  # which the difference ends or turns
    line = job.line_at(sample)
    where = "" if line is None else f", line {line} of the file"
    return f"{machine.axes[int(axis)]} at t {sample * machine.model.dt:.4g} s{where}"


def machine_warnings(replay: Replay, scenarios: Scenarios, machine: Machine) -> Iterator[Message]:
    """What to know of a machine and of its runs: the plan, swings, arrival."""
    for line in (
        *machine.remarks,
        *limits_exceeded_by_plan(scenarios, machine),
        *swing_warnings(replay, scenarios, machine),
        *arrival_warnings(replay, scenarios),
    ):
        yield warning(line)
