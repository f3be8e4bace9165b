"""The tolerance that a controller of a given length can promise on one axis, and its limits.

In coordinates of the steady motion along the reference r, d = r(k+1) - r(k),

    s = x - Sy r - Sv d,   u~ = u - k d,   s(k+1) = A s + B u~ + E w - Sv (d(k+1) - d(k)),
k d the control that carries the motion on. A reference that is not known ahead is a disturbance
whose size is its largest change of d, (acceleration) dt^2; a previewed one is none. The motion
takes its share of the limits in either case: |u~| <= control - |k d|, speeds likewise. What a
previewed reference needs to accelerate depends on the path and is not counted. An axis that a
constant control does not carry on, such as one with a spring to ground, has no such coordinates.

The tolerance is the optimum of the linear program of `jcontour.sets.least_peaks`: with the state
measured it is the least that finite responses of this length can promise.

What the controller knows of the state, and what that misses, is `jcontour.mpc.bounded.knowledge`.
"""

from typing import NamedTuple

import numpy as np

from jcontour.linear.plant import LinearPlant, steady_motion
from jcontour.mpc.bounded.knowledge import Knowledge
from jcontour.sets.disturbed_model import DisturbedModel, Signal
from jcontour.sets.least_peaks import LeastPeak, NoResponse, least_peak

STEADY = 1e-6  # relative, left over of the equations of a motion that a constant control carries on
MORE = 1.01  # of the limits that would just do: there the least tolerance is told


class DriveLimits(NamedTuple):
    """Largest magnitudes of control, its increment per sample, and the tool's speed [m/s]."""

    control: float = np.inf
    increment: float = np.inf
    speed: float = np.inf


class Motion(NamedTuple):
    """Largest speed [m/s] and acceleration [m/s^2] of a reference, and whether it is previewed."""

    speed: float
    acceleration: float
    previewed: bool


class AxisTolerance(NamedTuple):
    """Tolerance that can be promised.

    Attributes:
        promised: largest distance of the tool from the reference [m].
        optimum: of the program, without what the estimate misses; it names the limits that decide.
    """

    promised: float
    optimum: LeastPeak


def axis_tolerance(
    plant: LinearPlant, known: Knowledge, limits: DriveLimits, motion: Motion, length: int
) -> AxisTolerance:
    """The tolerance of one axis, and which limits keep it from being smaller.

    >>> from jcontour.linear.plant import LinearPlant
    >>> from jcontour.mpc.bounded.knowledge import state_known
    >>> slide = LinearPlant([[1, 1e-2], [0, 1]], [[5e-5], [1e-2]], [[1.0, 0.0]], dt=1e-2)
    >>> motion = Motion(speed=0.0, acceleration=0.0, previewed=True)
    >>> found = axis_tolerance(slide, state_known(slide, 1.0), DriveLimits(4.0), motion, 10)
    >>> f"{1e3 * found.promised:.3f} mm", found.optimum.limiting
    ('0.100 mm', ())

    Args:
        plant: one axis, one control.
        known: `state_known`, for the least tolerance, or `state_bounded_by_filter`, for a bound.
        limits: of the axis.
        motion: of the reference.
        length: samples after which the answer to a disturbance has come to rest.

    Raises:
        NoResponse: no response of this length keeps the limits; it names which, what would do, and
            the tolerance there. Or the motion and the disturbances alone take more than a limit.
        ValueError: no constant control carries the axis on, or bad input.
    """
    _check(plant, limits, motion)
    model, held = _around_the_motion(plant, known, motion)
    wide = model.with_last_control()
    room = _room(known, limits, motion, held, plant.dt)
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    last = np.zeros(1)
    moving = np.append(C @ (A - np.eye(len(A))) / plant.dt, last)
    signals = [
        *wide.control_signals(room.control),
        *wide.increment_signals(room.increment),
        Signal("speed", moving, (C @ B / plant.dt)[0], room.speed),
    ]
    limited = [one for one in signals if np.isfinite(one.limit)]
    small = wide.state_signals(["tool"], np.append(C, last))
    try:
        # the last control is a state of its own: it comes to rest one sample later
        found = least_peak(wide, small, limited, length + 1)
    except NoResponse as none:
        if not none.needed:
            raise NoResponse(
                f"length: no response of {length} samples comes to rest; a longer one may, "
                "if the control reaches every state",
                {},
                {},
            ) from None
        enough = [
            one._replace(limit=MORE * none.needed.get(one.name, one.limit)) for one in limited
        ]
        there = least_peak(wide, small, enough, length + 1)
        raise _too_small(none, limits, room, there.tolerance + known.tool[0], length) from None
    return AxisTolerance(found.tolerance + float(known.tool[0]), found)


def _check(plant: LinearPlant, limits: DriveLimits, motion: Motion) -> None:
    if (plant.axes, plant.inputs) != (1, 1):
        raise ValueError(
            f"plant: needs one output and one input, received {plant.axes}, {plant.inputs}"
        )
    for name, limit in limits._asdict().items():
        if not limit > 0:
            raise ValueError(f"limits: {name} needs to be above zero, received {limit}")
    for name, size in (("speed", motion.speed), ("acceleration", motion.acceleration)):
        if not (np.isfinite(size) and size >= 0):
            raise ValueError(f"motion: {name} needs to be finite, not negative, received {size}")


def _room(
    known: Knowledge, limits: DriveLimits, motion: Motion, held: float, dt: float
) -> DriveLimits:
    """The limits without the share of the motion and of what the controller cannot answer."""
    taken = DriveLimits(
        held * motion.speed,
        held * motion.acceleration * dt,
        motion.speed + float(known.speed[0]),
    )
    for name, share, limit in zip(DriveLimits._fields, taken, limits, strict=True):
        if not limit > share:
            raise NoResponse(
                f"limits: {name} at most {limit:.6g}, motion and disturbances alone take "
                f"{share:.6g}",
                {name: share},
                {name: limit},
            )
    return DriveLimits(*np.subtract(limits, taken).tolist())


def _too_small(
    none: NoResponse, limits: DriveLimits, room: DriveLimits, tolerance: float, length: int
) -> NoResponse:
    """The exception in the limits that were asked for, with the least tolerance of larger ones."""
    asked, left = limits._asdict(), room._asdict()
    needed = {name: asked[name] - left[name] + least for name, least in none.needed.items()}
    told = [
        f"{name} at most {asked[name]:.6g}, {most:.6g} would do" for name, most in needed.items()
    ]
    return NoResponse(
        f"limits: no response of {length} samples keeps them: {'; '.join(told)}; "
        f"just above, the least tolerance is {1e3 * tolerance:.4g} mm",
        needed,
        {name: asked[name] for name in needed},
    )


def _around_the_motion(
    plant: LinearPlant, known: Knowledge, motion: Motion
) -> tuple[DisturbedModel, float]:
    """The model in coordinates of the steady motion, and its control per speed of the motion.

    With A Sy = Sy and B k = Sy + Sv - A Sv the motion is carried on by a constant control.
    """
    model = DisturbedModel.of(plant.A, plant.B, known.E)
    maps = steady_motion(plant)
    along, on = np.asarray(maps.Sv), np.asarray(maps.Sy)
    wanted = on + along - model.A @ along
    carried = np.linalg.lstsq(model.B, wanted, rcond=None)[0]
    pulled = np.abs(model.A @ on - on) > STEADY * (np.abs(model.A) @ np.abs(on))
    terms = np.abs(on) + np.abs(along) + np.abs(model.A) @ np.abs(along)
    if pulled.any() or (np.abs(model.B @ carried - wanted) > STEADY * terms).any():
        raise ValueError(
            "plant: no constant control carries the axis on at constant speed, "
            "as with a spring to ground: its tolerance is not known"
        )
    held = abs(float(carried[0, 0])) * plant.dt
    if motion.previewed or motion.acceleration == 0:
        return model, held
    return model.with_disturbance(-along * motion.acceleration * plant.dt**2), held
