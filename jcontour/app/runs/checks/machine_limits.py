"""Limits of a machine at every sample of its runs, in cuts and in rapid moves."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jcontour.app.files.results.verdict import ROUNDING, LimitCheck
from jcontour.app.jobs.replays import Replay, Scenarios, desired, measured_speeds, unpadded
from jcontour.app.machines.machine import Machine, MachineLimits
from jcontour.simulation.limit_use import alternating

MET = 1 - 1e-9  # of a limit: a plant holds its control there
ASKED = 1 + 1e-6  # of what a reference asks for: rounding
PLAN_ROUNDING = 1e-4  # of a limit, in differences of a plan's samples
# of a limit, by which a loop may overshoot a motion that keeps it: drives trip at a tenth of the
# speed; an acceleration is limited for the motion, and a drive by its control
OVERSHOOT = {"speed": 0.05, "acceleration": 0.1}


def machine_limits(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[LimitCheck]:
    """Every limit of the machine, the largest value of the runs at any sample, and where.

    What is not scored, as an entry or a rapid move, counts too. A run that diverged is left out:
    its numbers mean nothing. To the largest acceleration that the samples show is added the largest
    that they hide.
    """
    counted, dt = unpadded(scenarios), machine.model.dt
    finite = [np.isfinite(rows).all(axis=(2, 3)) for rows in (replay.output, replay.control)]
    whole = finite[0] & finite[1] & ~np.asarray(replay.metrics.diverged)
    output, control = (
        np.where(whole[..., None, None], rows, 0.0) for rows in (replay.output, replay.control)
    )
    increment = np.diff(control, axis=-2)
    speed, acceleration = measured_speeds(output, dt)
    unit, limits = machine.control_unit, machine.limits
    inputs = [f"input {k + 1}" for k in range(machine.model.inputs)]
    checks = []
    for limit, quantity, values, names, shown in (
        (limits.speed, "speed", speed, machine.axes, "m/s"),
        (limits.acceleration, "acceleration", acceleration, machine.axes, "m/s^2"),
        (limits.control, "control", control, inputs, unit),
        (limits.increment, "control increment", increment, inputs, f"{unit} per sample"),
    ):
        if limit is None:
            continue
        peaks = largest_counted(values, counted)
        hidden, met = 0.0 * peaks, 0.0 * peaks
        overshoot = np.full(len(limit), ROUNDING)
        if quantity == "acceleration":
            unseen = alternating(control) @ machine.hidden_acceleration.T
            hidden = largest_counted(np.asarray(unseen), counted)
        if quantity in OVERSHOOT:
            motion = measured_speeds(desired(scenarios), dt)[quantity == "acceleration"]
            asked = largest_counted(motion[:, None], counted).max(axis=(0, 1))
            within = asked <= (1 + PLAN_ROUNDING) * limit
            overshoot = np.where(within, OVERSHOOT[quantity], ROUNDING)
        if quantity == "control":
            at_limit = counted[:, None, :, None] & (np.abs(values) >= MET * limit)
            met = at_limit.sum(axis=2) / counted.sum(axis=1)[:, None, None]
        peaks += hidden
        for k, name in enumerate(names):
            # of runs that reach the same peak, as at a limit, the one that is longest there
            place = max(np.ndindex(peaks.shape[:2]), key=lambda at: (peaks[*at, k], met[*at, k]))
            checks.append(
                LimitCheck(
                    name=f"{quantity} of {name}",
                    value=float(peaks[*place, k]),
                    allowed=float(limit[k]),
                    unit=shown,
                    member=f"{scenarios.jobs[place[0]].name}, {scenarios.plants[place[1]]}",
                    between=float(hidden[*place, k]),
                    slack=float(overshoot[k]),
                    saturated=float(met[*place, k]),
                )
            )
    return checks


def peak_controls(replay: Replay, scenarios: Scenarios) -> tuple[float, ...]:
    """Largest control of each input over every sample of the runs that did not diverge."""
    lost = np.asarray(replay.metrics.diverged)[..., None, None]
    control = np.where(lost, 0.0, replay.control)
    return tuple(largest_counted(control, unpadded(scenarios)).max(axis=(0, 1)).tolist())


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


def largest_counted(
    values: Float[np.ndarray, "contours plants rows axes"],
    counted: Bool[np.ndarray, "contours steps"],
) -> Float[np.ndarray, "contours plants axes"]:
    """Largest magnitude of differences whose samples are all counted."""
    whole = between_counted(counted, values.shape[2])
    return np.asarray(np.where(whole[:, None, :, None], np.abs(values), 0.0).max(axis=2))


def between_counted(
    counted: Bool[np.ndarray, "contours steps"], rows: int
) -> Bool[np.ndarray, "contours rows"]:
    """Which of the `rows` differences (contour, row) are between counted samples alone."""
    apart = counted.shape[1] - rows
    windows = np.lib.stride_tricks.sliding_window_view(counted, apart + 1, axis=1)
    return np.asarray(windows.all(axis=-1))
