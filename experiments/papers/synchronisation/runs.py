"""Runs of Tomizuka, Hu, Chiu & Kamano: two axes at a steady speed, a step of load on the second.

The paper prints neither plant nor gains. The nominal axes are chosen so that its two statements on
beta hold: at least 10 at 2 ms, around 3 and less than 4 at 10 ms. The others say what a weaker
feedback and unequal axes change.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.papers.synchronisation.result import CONTINUOUS, Bounds, Curve, Row
from jcontour.controllers.synchronisation.adaptive import (
    AdaptiveSynchronisation,
    SynchronisedGains,
)
from jcontour.controllers.synchronisation.continuous import (
    ContinuousGains,
    Motion,
    continuous_response,
)
from jcontour.controllers.synchronisation.limits import (
    SampledLoop,
    continuous_bound,
    exact_bound,
    positive_real_bound,
    sampled_loop,
)
from jcontour.controllers.synchronisation.speed_axes import SpeedAxes, speed_axes
from jcontour.motion.references import Reference, from_samples
from jcontour.plants.servo_axes import servo_axes
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate

SPEED, LOAD, BIAS = 1.0, 1.0, 1.0  # per unit, chosen
STEP, END = 0.2, 1.2  # [s] of the load, and of the run
LOST = 1e6  # a speed beyond has diverged
STATE = Sensors((0, 2), (1, 3))  # of `servo_axes`: y, v of one axis, then of the other
NOTICED = 1e-3  # of the peak: smaller swings are not counted
MILLISECOND = 1e-3

NOMINAL, WEAK, UNEQUAL = "nominal", "weak feedback", "unequal axes"


@dataclass(frozen=True)
class Plant:
    """Two axes and the gains of their law.

    Attributes:
        axes: poles [rad/s] and gains.
        proportional: k_c of both axes.
        adaptation: gamma of continuous time [1/s]; sampled it is gamma T.
    """

    axes: SpeedAxes
    proportional: tuple[float, float]
    adaptation: float


PLANTS = {
    NOMINAL: Plant(speed_axes([10.0, 10.0], [50.0, 50.0]), (0.3, 0.3), 11.0),
    WEAK: Plant(speed_axes([10.0, 10.0], [50.0, 50.0]), (0.2, 0.2), 18.0),
    UNEQUAL: Plant(speed_axes([10.0, 5.0], [50.0, 30.0]), (0.3, 0.1), 11.0),
}


def stepped(plant: Plant, period_ms: float, beta: float, name: str, samples: int) -> Curve:
    """Errors of both axes under the step of load, from the step on.

    Args:
        plant: the axes and their gains.
        period_ms: sample period; zero is continuous time.
        beta: coupling.
        name: of the plant.
        samples: instants of a continuous response.
    """
    if period_ms == CONTINUOUS:
        times, errors = _continuous(plant, beta, samples)
    else:
        times, errors = _sampled(plant, MILLISECOND * period_ms, beta)
    return Curve(name, period_ms, beta, times, *errors.T)


def _continuous(plant: Plant, beta: float, samples: int):
    """Instants from the step of load on, and the errors there."""
    times = np.linspace(STEP, END, samples)
    gains = ContinuousGains(np.array(plant.proportional), plant.adaptation, beta, BIAS)
    motion = Motion(_constant(SPEED), _constant(0.0), _load, (STEP,))
    return times, continuous_response(plant.axes, gains, motion, times).error


def _sampled(plant: Plant, dt: float, beta: float):
    """The same by the sampled law, every sample."""
    first, steps = round(STEP / dt), round(END / dt) + 1
    force = np.zeros((steps, 2))
    force[first:, 1] = LOAD
    machine = servo_axes(plant.axes.gain, plant.axes.pole, dt)
    loaded = Disturbed(machine, force=jnp.asarray(force))
    rollout = simulate(loaded, law(plant, dt, beta), steady(steps, dt))
    errors = SPEED - np.asarray(rollout.measurement)[:, [1, 3]]
    return dt * np.arange(first, steps), errors[first:]


def law(plant: Plant, dt: float, beta: float) -> AdaptiveSynchronisation:
    """The sampled law; its estimates start where they fit the axes."""
    gains = SynchronisedGains(plant.proportional, plant.adaptation * dt, beta, bias=BIAS)
    return AdaptiveSynchronisation(gains, STATE, dt, plant.axes.feedforward(dt))


def steady(steps: int, dt: float) -> Reference:
    """Both axes at the steady speed."""
    path = SPEED * dt * np.arange(steps + 2)
    along = np.full((len(path), 2), np.sqrt(0.5))
    return from_samples(np.stack([path, path], axis=1), along, dt, preview=2)


def scored(curve: Curve) -> Row:
    """Numbers of a response."""
    errors = np.stack([curve.e1, curve.e2, curve.apart])
    lost = bool(not np.all(np.isfinite(errors)) or np.max(np.abs(errors[:2] - SPEED)) > LOST)
    peaks = np.max(np.abs(errors), axis=1) if not lost else np.full(3, np.inf)
    apart = np.abs(curve.apart)
    return Row(
        plant=curve.plant,
        period_ms=curve.period_ms,
        beta=curve.beta,
        peak_sync=float(peaks[2]),
        iae_sync=np.inf if lost else float(np.trapezoid(apart, curve.time_s)),
        peak_e1=float(peaks[0]),
        peak_e2=float(peaks[1]),
        final_sync=np.inf if lost else float(apart[-1]),
        turns=0 if lost else turns(curve.apart),
        diverged=lost,
    )


def turns(signal: Float[np.ndarray, " T"]) -> int:
    """How often a signal changes its sign; values below a thousandth of the peak do not count."""
    seen = signal[np.abs(signal) > NOTICED * np.max(np.abs(signal), initial=0.0)]
    return int(np.sum(seen[1:] * seen[:-1] < 0))


def loop_of(plant: Plant, period_ms: float) -> SampledLoop:
    """Sampled loop of the plant, for its bounds."""
    dt = MILLISECOND * period_ms
    return sampled_loop(plant.axes, plant.proportional, plant.adaptation * dt, SPEED, dt, BIAS)


def bounds(name: str, period_ms: float) -> Bounds:
    """All bounds of a plant at a sample period."""
    plant = PLANTS[name]
    loop = loop_of(plant, period_ms)
    largest = continuous_bound(plant.axes, plant.proportional)
    return Bounds(
        plant=name,
        period_ms=period_ms,
        adaptation=loop.adaptation,
        continuous=largest if np.isfinite(largest) else None,
        proven=positive_real_bound(loop),
        exact=exact_bound(loop),
    )


def _load(t: float) -> Float[np.ndarray, "2"]:
    return np.array([0.0, LOAD * (t >= STEP)])


def _constant(value: float) -> Callable[[float], float]:
    return lambda t: value
