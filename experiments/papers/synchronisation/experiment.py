"""Tomizuka, Hu, Chiu & Kamano 1990: two axes kept together by adaptive feedforward.

The paper prints neither plant nor gains: only its statements can be reproduced. Two axes run at a
steady speed, and a step of load acts on the second. The nominal axes are chosen so that the two
statements on beta hold: at least 10 at 2 ms, around 3 and less than 4 at 10 ms. The others say what
a weaker feedback and unequal axes change.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.papers.synchronisation.companions import Cycles, Schedule, learned, scheduled
from experiments.tables import where
from jcontour import simulate
from jcontour.controllers import AdaptiveSynchronisation, SynchronisedGains
from jcontour.controllers.synchronisation.speed_axes import (
    ContinuousGains,
    Motion,
    SpeedAxes,
    continuous_bound,
    continuous_response,
    exact_bound,
    positive_real_bound,
    sampled_loop,
    speed_axes,
)
from jcontour.motion import from_samples
from jcontour.plants import Disturbed, servo_axes
from jcontour.sensors import Sensors

SOURCE = (
    "M. Tomizuka, J.-S. Hu, T.-C. Chiu, T. Kamano: Synchronization of Two Motion Control Axes "
    "Under Adaptive Feedforward Control. ASME Winter Annual Meeting (1990)"
)
CONTINUOUS, FAST, SLOW = 0.0, 2.0, 10.0  # sample periods [ms]; zero is continuous time
SPEED, LOAD, BIAS = 1.0, 1.0, 1.0  # per unit, chosen
STEP, END = 0.2, 1.2  # [s] of the load, and of the run
LOST = 1e6  # a speed beyond has diverged
STATE = Sensors((0, 2), (1, 3))  # of `servo_axes`: y, v of one axis, then of the other
NOTICED = 1e-3  # of the peak: smaller swings are not counted
MILLISECOND = 1e-3
NOMINAL, WEAK, UNEQUAL = "nominal", "weak feedback", "unequal axes"
BETAS = {  # plant, period [ms] -> couplings
    (NOMINAL, CONTINUOUS): (0.0, 1.0, 2.0, 5.0, 10.0),
    (NOMINAL, FAST): (0.0, 1.0, 2.0, 3.0, 5.0, 10.0),
    (NOMINAL, SLOW): (0.0, 1.0, 2.0, 3.0, 3.5, 4.0),
    (WEAK, CONTINUOUS): (0.0, 5.0),
    (WEAK, SLOW): (0.0, 1.0, 3.0, 3.7, 4.0),
    (UNEQUAL, CONTINUOUS): (0.0, 1.0, 5.0),
    (UNEQUAL, FAST): (0.0, 1.0, 5.0),
}
INSTANTS, QUICK_INSTANTS = 2401, 601  # of a continuous response


@dataclass(frozen=True)
class Plant:
    """Two axes and the gains of their law."""

    axes: SpeedAxes  # poles [rad/s] and gains
    proportional: tuple[float, float]  # k_c of both axes
    adaptation: float  # gamma of continuous time [1/s]; sampled it is gamma T


PLANTS = {
    NOMINAL: Plant(speed_axes([10.0, 10.0], [50.0, 50.0]), (0.3, 0.3), 11.0),
    WEAK: Plant(speed_axes([10.0, 10.0], [50.0, 50.0]), (0.2, 0.2), 18.0),
    UNEQUAL: Plant(speed_axes([10.0, 5.0], [50.0, 30.0]), (0.3, 0.1), 11.0),
}


@dataclass(frozen=True)
class Row:
    """Response to the step of load on axis 2; speeds per unit."""

    plant: str
    period_ms: float  # zero is continuous time
    beta: float
    peak_sync: float  # largest difference of the two errors
    iae_sync: float  # integral of its magnitude [s]
    peak_e1: float  # largest error of the axis without load
    peak_e2: float  # and of the axis with load
    turns: int  # how often the difference goes through zero, above a thousandth of its peak
    diverged: bool  # a speed passed a million
    time_s: Float[np.ndarray, " T"]
    e1: Float[np.ndarray, " T"]
    e2: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class Bounds:
    """Bounds on beta of one loop."""

    plant: str
    period_ms: float
    continuous: float | None  # largest beta with (9) positive definite; None where any is
    proven: float  # smallest beta at which (17) is no longer strictly positive real
    exact: float  # smallest beta at which the loop is no longer stable


@dataclass(frozen=True)
class Result:
    """Responses of all plants, periods and couplings, and bounds on the coupling.

    Then the two companions in the volume.
    """

    rows: tuple[Row, ...]
    bounds: tuple[Bounds, ...]
    schedule: Schedule
    cycles: Cycles

    def row(self, plant: str, period_ms: float, beta: float) -> Row:
        """Response of this plant, period and coupling."""
        return where(self.rows, plant=plant, period_ms=period_ms, beta=beta)[0]

    def bound(self, plant: str, period_ms: float) -> Bounds:
        """Bounds of this plant and period."""
        return where(self.bounds, plant=plant, period_ms=period_ms)[0]


def run(quick: bool = False) -> Result:
    """Simulate everything."""
    samples = QUICK_INSTANTS if quick else INSTANTS
    return Result(
        rows=tuple(
            stepped(name, period_ms, beta, samples)
            for (name, period_ms), betas in BETAS.items()
            for beta in betas
        ),
        bounds=tuple(bounds(name, period) for name, period in BETAS if period != CONTINUOUS),
        schedule=scheduled(),
        cycles=learned(),
    )


def stepped(name: str, period_ms: float, beta: float, samples: int) -> Row:
    """Response of a plant from the step of load on; a continuous one at so many samples."""
    plant, dt = PLANTS[name], MILLISECOND * period_ms
    if period_ms == CONTINUOUS:
        times = np.linspace(STEP, END, samples)
        gains = ContinuousGains(np.array(plant.proportional), plant.adaptation, beta, BIAS)
        motion = Motion(
            lambda t: SPEED, lambda t: 0.0, lambda t: np.array([0.0, LOAD * (t >= STEP)]), (STEP,)
        )
        errors = continuous_response(plant.axes, gains, motion, times).error
    else:
        first, steps = round(STEP / dt), round(END / dt) + 1
        force = np.zeros((steps, 2))
        force[first:, 1] = LOAD
        machine = servo_axes(plant.axes.gain, plant.axes.pole, dt)
        loaded = Disturbed(machine, force=jnp.asarray(force))
        path = SPEED * dt * np.arange(steps + 2)  # both axes at the steady speed
        along = np.full((len(path), 2), np.sqrt(0.5))
        steady = from_samples(np.stack([path, path], axis=1), along, dt, preview=2)
        # the estimates start where they fit the axes
        gains = SynchronisedGains(plant.proportional, plant.adaptation * dt, beta, bias=BIAS)
        law = AdaptiveSynchronisation(gains, STATE, dt, plant.axes.feedforward(dt))
        speeds = np.asarray(simulate(loaded, law, steady).measurement)[:, [1, 3]]
        times, errors = dt * np.arange(first, steps), (SPEED - speeds)[first:]
    e1, e2 = errors.T
    apart = e1 - e2
    peak_e1, peak_e2, peak_sync = np.max(np.abs([e1, e2, apart]), axis=1)
    numbers = peak_sync, np.trapezoid(np.abs(apart), times), peak_e1, peak_e2
    lost = bool(not np.all(np.isfinite(numbers)) or np.max(np.abs(errors - SPEED)) > LOST)
    sizes = [np.inf if lost else float(x) for x in numbers]
    changes = 0 if lost else turns(apart)
    return Row(name, period_ms, beta, *sizes, changes, lost, times, e1, e2)


def turns(signal: Float[np.ndarray, " T"]) -> int:
    """How often a signal changes its sign; values below a thousandth of the peak do not count."""
    seen = signal[np.abs(signal) > NOTICED * np.max(np.abs(signal), initial=0.0)]
    return int(np.sum(seen[1:] * seen[:-1] < 0))


def bounds(name: str, period_ms: float) -> Bounds:
    """All bounds of a plant at a sample period."""
    plant, dt = PLANTS[name], MILLISECOND * period_ms
    loop = sampled_loop(plant.axes, plant.proportional, plant.adaptation * dt, SPEED, dt, BIAS)
    largest = continuous_bound(plant.axes, plant.proportional)
    continuous = largest if np.isfinite(largest) else None
    limits = positive_real_bound(loop), exact_bound(loop)
    return Bounds(name, period_ms, continuous, *limits)
