"""Limits that a streaming law keeps, the faults that trip it, and the limits of its memory.

The last are limits that a controller keeps its own memory within, as the integrator of a cascade.
They are found from its step: far away from zero an entry that is kept within a limit comes back at
the limit, whichever way and however far. Then the step with limits is compared with that without
them, kept to what was found.
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jcontour.analysis.frozen_loops import unlimited
from jcontour.controller import Controller

PerAxis = Float[np.ndarray, " m"]
RECOVERY = 0.25  # of the speed and acceleration limit: with the feed it stays below both
QUICK = 1.5  # of the speed limit: a measurement that is quicker has jumped
COUNTS = 4  # of an encoder: noise and rounding of two measurements
PUSH = 0.2  # of the limit of the control, that no machine takes standing still
NUDGE = 0.02  # likewise, for a while
STUCK = 3.0  # times the friction: a reversal takes two
SPEED_UP = 0.1  # [s] to full speed where no acceleration is stated


@dataclass(frozen=True)
class SafeLimits:
    """Limits of a law, in SI and control units.

    Attributes:
        increment: of every control in a sample; infinite where there is none.
        speed: of the commanded motion of every axis [m/s].
        recovery_speed: with which an axis returns to the path [m/s].
        recovery_acceleration: likewise [m/s^2].
        reach: most distance of an axis from the path, at which it may be enabled [m].
        near: distance that needs no recovery [m].
        following: error of an axis that trips [m].
        jump: change of a measurement in a sample that is not believed; infinite where none.
        freeze: commanded way without a change of the measurement that trips [m].
        push: change of the control behind a measurement that trips, where the measurement does not
            change for `wait` samples more than the dead time; `nudge` likewise, for `idle` samples.
        stop: time of a feed hold from full speed [s].
        lost: samples in a row without a measurement that trip, and `missed` of deadlines.
    """

    increment: Float[np.ndarray, " p"]
    speed: PerAxis
    recovery_speed: PerAxis
    recovery_acceleration: PerAxis
    reach: PerAxis
    near: PerAxis
    following: PerAxis
    jump: Float[np.ndarray, " q"]
    freeze: PerAxis
    push: Float[np.ndarray, " q"]
    nudge: Float[np.ndarray, " q"]
    stop: float
    wait: int = 4  # in which a push passes a count
    idle: int = 20  # in which friction breaks loose
    lost: int = 5  # 5 ms at 1 kHz: an observer bridges them
    missed: int = 3


@dataclass(frozen=True)
class Stated:
    """What is known of a machine and of one run: the rest follows by rule.

    Attributes:
        speed, acceleration: limits of the axes; None where not stated.
        increment: of the controls; None where not stated.
        control: limit of the controls; None where not stated.
        friction: control that dry friction takes; None where not known.
        count: resolution of a measurement [m].
        fastest: speed of every axis in the run [m/s].
        error: largest following error of every axis in the run [m].
        largest: of every control in the run.
    """

    speed: PerAxis | None
    acceleration: PerAxis | None
    increment: Float[np.ndarray, " p"] | None
    control: Float[np.ndarray, " p"] | None
    friction: Float[np.ndarray, " p"] | None
    count: PerAxis
    fastest: PerAxis
    error: PerAxis
    largest: Float[np.ndarray, " p"]


def safe_limits(
    stated: Stated,
    places: Float[np.ndarray, "m q"],
    drives: Float[np.ndarray, "q p"],
    dt: float,
) -> SafeLimits:
    """Limits by rule where none are stated.

    The speed is then twice that of the quickest axis of the run. The following error trips at three
    times that of the run, at least at 0.2 mm. A measurement that moves half as quick again as the
    speed limit has jumped. One that stays is frozen: while 20 counts, at least 50 um, are
    commanded, while the control behind it changes by a fifth of its limit, or for 20 samples by a
    fiftieth of it and by more than friction explains. A control that goes back to zero, as at the
    end of braking, pushes nothing.

    Args:
        stated: what is known.
        places: positions of the axes in a measurement.
        drives: the control behind each measurement.
        dt: sample period [s].
    """
    axes = places.shape[0]
    speed = stated.speed
    if speed is None:
        speed = np.full(axes, 2.0 * stated.fastest.max())
    acceleration = speed / SPEED_UP if stated.acceleration is None else stated.acceleration
    following = np.maximum(3.0 * stated.error, 2e-4)
    step = QUICK * speed * dt + COUNTS * stated.count
    position = np.abs(places) > 0.0  # which measurement is a position of which axis
    each = np.where(position, step[:, None] / np.where(position, np.abs(places), 1.0), -np.inf)
    jump = np.where(position.any(axis=0), each.max(axis=0), np.inf)
    full = 2.0 * stated.largest if stated.control is None else stated.control
    stuck = PUSH / 2.0 * full if stated.friction is None else STUCK * stated.friction
    inputs = len(full)
    return SafeLimits(
        increment=np.full(inputs, np.inf) if stated.increment is None else stated.increment,
        speed=speed,
        recovery_speed=RECOVERY * speed,
        recovery_acceleration=RECOVERY * acceleration,
        reach=np.full(axes, 0.01),
        near=COUNTS * stated.count,
        following=following,
        jump=jump,
        freeze=np.maximum(20.0 * stated.count, 5e-5),
        push=drives @ (PUSH * full),
        nudge=drives @ np.maximum(NUDGE * full, stuck),
        stop=float(np.max(speed / acceleration)),
    )


FAR = 1e12  # of every number that is remembered and measured
TRIES = 200  # memories and measurements on which the limits are compared, of 1e-3 up to FAR
SAME = 1e-9  # of the largest number of a try


def memory_limits(
    controller: Controller, plan: Any, memory: Any, measurement: Any
) -> tuple[Float[np.ndarray, " n"] | None, bool]:
    """Limit of every entry of the memory, +-, and whether limits do nothing else to it.

    None where there are none; infinite for an entry without one.

    Args:
        controller: whose step is affine but for its limits.
        plan: one row.
        memory: what it may remember; floats are tried, the rest stays.
        measurement: likewise.
    """
    free = unlimited(controller)
    if eqx.tree_equal(*jax.device_get((controller, free))):
        return None, True
    moving, fixed = eqx.partition((memory, measurement), eqx.is_inexact_array)
    flat, unravel = ravel_pytree(moving)

    @eqx.filter_jit
    def stepped(one: Controller, numbers: Float[Array, "tries numbers"]) -> Float[Array, "tries n"]:
        def step(row: Float[Array, " numbers"]) -> Float[Array, " n"]:
            remembered, measured = eqx.combine(unravel(row), fixed)
            after, _ = one.step(remembered, plan, measured)
            return ravel_pytree(eqx.filter(after, eqx.is_inexact_array))[0]

        return jax.vmap(step)(numbers)

    random = np.random.default_rng(0)
    away = FAR * random.normal(size=flat.size)
    ends = np.asarray(stepped(controller, jnp.asarray([away, 2 * away, -away])))
    saturates = (ends[0] == ends[1]) & (ends[0] == -ends[2]) & (ends[0] != 0.0)
    kept = np.where(saturates, np.abs(ends[0]), np.inf)
    sizes = 10.0 ** random.uniform(-3.0, np.log10(FAR), (TRIES, 1))
    numbers = jnp.asarray(sizes * random.normal(size=(TRIES, flat.size)))
    after, without = (np.asarray(stepped(one, numbers)) for one in (controller, free))
    apart = np.abs(after - np.clip(without, -kept, kept))
    exact = bool((apart <= SAME * np.abs(without).max(axis=1, keepdims=True, initial=0.0)).all())
    return (kept if saturates.any() else None), exact
