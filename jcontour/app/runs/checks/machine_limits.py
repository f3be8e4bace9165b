"""Limits of a machine that a run comes near or exceeds, in cuts and in rapid moves."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.app.files.results.verdict import ROUNDING, LimitCheck
from jcontour.app.jobs.job import Job
from jcontour.app.jobs.replays import Replay, Scenarios, desired, measured_speeds, scored
from jcontour.app.machines.machine import Machine, MachineLimits
from jcontour.simulation.limit_use import alternating

DRIVES = ("control of", "control increment of")
MET = 1 - 1e-9  # of a limit: a plant holds its control there
ASKED = 1 + 1e-6  # of what a reference asks for: rounding
PLAN_ROUNDING = 1e-4  # of a limit, in differences of a plan's samples
# of a limit, by which a loop may overshoot a motion that keeps it: drives trip at a tenth of the
# speed; an acceleration is limited for the motion, and a drive by its control
OVERSHOOT = {"speed": 0.05, "acceleration": 0.1}


class Signals(NamedTuple):
    """Signals of runs on every plant along every contour, and the names of both."""

    output: Float[np.ndarray, "contours plants steps axes"]  # tool [m]
    control: Float[np.ndarray, "contours plants steps inputs"]  # of every input
    counted: Bool[np.ndarray, "contours steps"]  # samples whose peaks count
    contours: Sequence[str]  # names
    plants: Sequence[str]  # names
    # motion that is followed [m], where its speed is compared with its limit
    asked: Float[np.ndarray, "contours steps axes"] | None = None


def machine_limits(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[LimitCheck]:
    """Every limit of the machine with the largest value of the runs where they are scored."""
    return list(_checks(_replayed(replay, scenarios, scored(scenarios)), machine))


def beyond_limits_asked(
    position: Float[np.ndarray, "T m"],
    before: Float[np.ndarray, "T m"],
    machine: Machine,
    at_rest: bool,
) -> list[LimitCheck]:
    """Every axis limit that a reference [m] exceeds, and more than the one `before` it did.

    Its speed and acceleration are differences of its samples.
    """
    asked, usual = (largest_asked(rows, machine.model.dt, at_rest) for rows in (position, before))
    checks = limits_asked(*asked, machine.limits, machine.axes)
    known = limits_asked(*usual, machine.limits, machine.axes)
    return [
        check
        for check, was in zip(checks, known, strict=True)
        if check.value > max(check.allowed, ASKED * was.value)
    ]


def limits_asked(
    speed: Float[np.ndarray, " m"],
    acceleration: Float[np.ndarray, " m"],
    limits: MachineLimits,
    axes: Sequence[str],
) -> list[LimitCheck]:
    """The stated limits beside the largest speed [m/s] and acceleration [m/s^2] of a reference."""
    return [
        LimitCheck(
            name=f"{quantity} of {axis} that the reference asks for",
            value=float(most[k]),
            allowed=float(limit[k]),
            unit=unit,
        )
        for quantity, most, limit, unit in (
            ("speed", speed, limits.speed, "m/s"),
            ("acceleration", acceleration, limits.acceleration, "m/s^2"),
        )
        if limit is not None
        for k, axis in enumerate(axes)
    ]


def largest_asked(
    position: Float[np.ndarray, "T m"], dt: float, at_rest: bool
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Largest speed [m/s] and acceleration [m/s^2] that a reference asks of every axis.

    Its first step from rest and its last one to rest count, where it has them.
    """
    if at_rest:
        position = np.concatenate([position[:1], position, position[-1:]])
    speed, acceleration = measured_speeds(position, dt)
    return np.abs(speed).max(axis=0), np.abs(acceleration).max(axis=0)


def drives_at_limits_in_rapids(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for every limit of a drive that is met in rapid moves of programs.

    They are not scored, but a tool that falls behind there is late in the next cut. Speed and
    acceleration, which the motion itself takes to their limits, say nothing of this.
    """
    # Which samples are of rapid moves: those of whole programs that do not count
    rapid = np.zeros((len(scenarios.jobs), scenarios.references.steps), bool)
    for row, job in zip(rapid, scenarios.jobs, strict=True):
        if isinstance(job, Job) and job.program is not None:
            row[: job.steps] = ~job.counted
    if not rapid.any():
        return []
    return [
        f"{one.name} is at its limit in a rapid move: {one.size} ({one.member}); a lower "
        "speed or acceleration in the limits of the machine keeps it below"
        for one in _checks(_replayed(replay, scenarios, rapid), machine)
        if one.name.startswith(DRIVES) and one.value >= MET * one.allowed
    ]


def _replayed(
    replay: Replay, scenarios: Scenarios, counted: Bool[np.ndarray, "contours steps"]
) -> Signals:
    """The signals of a replay; a run that diverged is not finite."""
    lost = np.asarray(replay.metrics.diverged)[..., None, None]
    output, control = (np.where(lost, np.nan, rows) for rows in (replay.output, replay.control))
    names = [job.name for job in scenarios.jobs]
    return Signals(output, control, counted, names, scenarios.plants, desired(scenarios))


def _checks(seen: Signals, machine: Machine) -> Iterator[LimitCheck]:
    """Peak of every limited quantity of every axis in the samples that are counted, and where.

    A run that is not finite is left out: its numbers mean nothing. To the largest acceleration that
    the samples show is added the largest that they hide.
    """
    lost = ~(_finite(seen.output) & _finite(seen.control))[..., None, None]
    output, control = (np.where(lost, 0.0, rows) for rows in (seen.output, seen.control))
    increment = np.diff(control, axis=-2)
    speed, acceleration = measured_speeds(output, machine.model.dt)
    unit, limits = machine.control_unit, machine.limits
    inputs = [f"input {k + 1}" for k in range(machine.model.inputs)]
    for limit, quantity, values, names, shown in (
        (limits.speed, "speed", speed, machine.axes, "m/s"),
        (limits.acceleration, "acceleration", acceleration, machine.axes, "m/s^2"),
        (limits.control, "control", control, inputs, unit),
        (limits.increment, "control increment", increment, inputs, f"{unit} per sample"),
    ):
        if limit is None:
            continue
        peaks = largest_counted(values, seen.counted)
        hidden = 0.0 * peaks
        if quantity == "acceleration":
            unseen = alternating(control) @ machine.hidden_acceleration.T
            hidden = largest_counted(np.asarray(unseen), seen.counted)
        peaks += hidden
        overshoot = np.full(len(limit), ROUNDING)
        if quantity in OVERSHOOT and seen.asked is not None:
            motion = measured_speeds(seen.asked, machine.model.dt)[quantity == "acceleration"]
            asked = np.abs(motion).max(axis=(0, 1))
            within = asked <= (1 + PLAN_ROUNDING) * limit
            overshoot = np.where(within, OVERSHOOT[quantity], ROUNDING)
        for k, name in enumerate(names):
            place = np.unravel_index(np.argmax(peaks[:, :, k]), peaks.shape[:2])
            yield LimitCheck(
                name=f"{quantity} of {name}",
                value=float(peaks[*place, k]),
                allowed=float(limit[k]),
                unit=shown,
                member=f"{seen.contours[int(place[0])]}, {seen.plants[int(place[1])]}",
                between=float(hidden[*place, k]),
                slack=float(overshoot[k]),
            )


def largest_counted(
    values: Float[np.ndarray, "contours plants rows axes"],
    counted: Bool[np.ndarray, "contours steps"],
) -> Float[np.ndarray, "contours plants axes"]:
    """Largest magnitude of differences whose samples are all counted."""
    whole = between_counted(counted, values.shape[2])
    return np.asarray(np.where(whole[:, None, :, None], np.abs(values), 0.0).max(axis=2))


def _finite(rows: np.ndarray) -> np.ndarray:
    """Which runs (contour, plant) are finite at every sample."""
    return np.asarray(np.isfinite(rows).all(axis=(2, 3)))


def between_counted(
    counted: Bool[np.ndarray, "contours steps"], rows: int
) -> Bool[np.ndarray, "contours rows"]:
    """Which of the `rows` differences (contour, row) are between counted samples alone."""
    apart = counted.shape[1] - rows
    windows = np.lib.stride_tricks.sliding_window_view(counted, apart + 1, axis=1)
    return np.asarray(windows.all(axis=-1))
