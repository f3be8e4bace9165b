"""Lam, Manzie & Good 2011: model predictive contouring control of an X-Y table, Figs 8 to 13.

The paper shows measurements. Its contour, the friction of its table and the weights of its
baselines are not printed: ours are named below. Only the comparison of the controllers can be
reproduced.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour import Contour, Plant, Reference, simulate
from jcontour.app.designs.predictive import at_speed, late_tracking
from jcontour.controllers import Cascade, CascadeGains
from jcontour.geometry import polar_lobes
from jcontour.host import reported_loop
from jcontour.host.controller import HostController
from jcontour.host.held import Held
from jcontour.host.loop import Stopped
from jcontour.motion import along
from jcontour.mpc import MPCC, ContouringWeights, TrackingWeights
from jcontour.plants import FrictionXYTable, xy_table
from jcontour.plants.xy_table import X_DRIVE, Y_DRIVE
from jcontour.sensors import Sensors
from jcontour.simulation import traversal_score
from jcontour.simulation.closed_loop import Rollout
from jcontour.simulation.traversal import Score

SOURCE = (
    "D. Lam, C. Manzie, M. Good: Application of Model Predictive Contouring Control to an X-Y "
    "Table. IFAC World Congress (2011)"
)
MPCC_4MS, MPTC_4MS, PI_4MS, PI_1MS = CONTROLLERS = ("MPCC 4 ms", "MPTC 4 ms", "PI 4 ms", "PI 1 ms")
TRACE_WEIGHTS = (0.03, 5.0)  # q_theta of Figs 8 to 11
# q_theta of Fig. 13; 0.02 is slow enough for the slowest of the others
WEIGHTS = (0.02, 0.03, 0.1, 0.3, 1.0, 5.0)
SPEEDS = (0.05, 0.075, 0.1, 0.125, 0.15)  # [m/s] of the tracking controllers, section 5
SHOWN_PLANT = "friction"  # of Figs 8 to 11: the nearest there is to the paper's machine
SAMPLE = 1e-3  # [s] of the simulation
PERIOD = 4e-3  # [s] of MPCC, MPTC and the slow PI
HORIZON, LARGEST_CURRENT = 7, 0.5  # section 5; [A]
LONGEST = 12.0  # [s] beyond which a run counts as one that does not arrive
ARRIVED = 5e-4  # [m] of arc length before the end: there a trace ends
HEAVIER = 1.1  # inertias and viscous friction of the mismatched machine
WEAKER = 0.9  # its link and its torque constant
# Q_t and R_t are not printed: MPCC's own; a decade more or less changes 2 %
TRACKING = TrackingWeights(output=1e8, increment=60.0)
# PI gains are not printed: the best of a grid of 336 (240) on the friction machine at 0.1 m/s;
# feedforward made them worse
CASCADE = {
    1e-3: CascadeGains(80.0, 20.0, 0.04),
    4e-3: CascadeGains(60.0, 14.0, 0.04),
}
SENSORS = Sensors(position=(2, 6), velocity=(1, 5), scale=0.7958e-3)  # tool position, motor speed


@dataclass(frozen=True)
class Trace:
    """Signals of one run of MPCC up to the end of the path, Figs 8 to 11; axes (time, axis)."""

    q_theta: float
    theta_mm: Float[np.ndarray, " T"]  # path parameter: 0 at the end, as in the paper
    tool_mm: Float[np.ndarray, "T 2"]
    foot_mm: Float[np.ndarray, "T 2"]  # nearest point of the path
    control_a: Float[np.ndarray, "T 2"]
    speed_mm_s: Float[np.ndarray, " T"]
    contour_error_um: Float[np.ndarray, " T"]
    curvature_per_mm: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class Point:
    """One run in Fig. 13: how long it takes, and how far it leaves the path."""

    controller: str
    plant: str
    setting: str
    finished: bool
    time_s: float  # not finite when the tool does not arrive
    rms_percent: float  # of the largest radius


@dataclass(frozen=True)
class Result:
    """Figs 8 to 11 on one machine, Fig. 13 on all."""

    plants: tuple[str, ...]
    points_mm: Float[np.ndarray, "points 2"]  # of the contour
    traces: tuple[Trace, ...]  # q_theta ascending
    trade_off: tuple[Point, ...]


def run(quick: bool = False) -> Result:
    """Simulate everything."""
    contour = lobes()
    arc = np.linspace(0.0, float(contour.length), 4001)  # every fourth sample is drawn
    path = np.asarray(contour.position(arc))
    radius = float(np.linalg.norm(path, axis=1).max())
    plants = (SHOWN_PLANT,) if quick else tuple(machines(SAMPLE))
    traces: list[Trace] = []
    points: list[Point] = []
    for plant in plants:
        fine, coarse = machines(SAMPLE)[plant], machines(PERIOD)[plant]
        for weight in WEIGHTS:
            outcome, controller = traced(fine, contour, weight)
            points.append(point(MPCC_4MS, plant, f"q_theta {weight:g}", outcome, radius))
            if weight in TRACE_WEIGHTS and plant == SHOWN_PLANT:
                score, rollout, length = outcome.score, outcome.rollout, float(contour.length)
                done = int(np.argmax(score.arc >= length - ARRIVED)) or len(score.arc)
                arc, memory = score.arc[:done], rollout.memory.inner
                trace = Trace(
                    q_theta=weight,
                    theta_mm=1e3 * (arc - length),
                    tool_mm=1e3 * np.asarray(rollout.output)[:done],
                    foot_mm=1e3 * np.asarray(contour.position(arc)),
                    control_a=np.asarray(rollout.control)[:done],
                    speed_mm_s=1e3 * controller.speed(memory)[:done],
                    contour_error_um=1e6 * score.error[:done],
                    curvature_per_mm=1e-3 * np.asarray(contour.curvature(arc)),
                )
                traces.append(trace)
        for speed in SPEEDS:
            setting = f"{1e3 * speed:g} mm/s"
            points += [
                point(MPTC_4MS, plant, setting, tracked(fine, contour, speed), radius),
                point(PI_4MS, plant, setting, cascaded(coarse, contour, speed), radius),
                point(PI_1MS, plant, setting, cascaded(fine, contour, speed), radius),
            ]
    return Result(plants, 1e3 * path[::4], tuple(traces), tuple(points))


class Outcome(NamedTuple):
    """A rollout and its score."""

    rollout: Rollout
    score: Score


def lobes() -> Contour:
    """Contour of four lobes, 30 +- 10 mm, with size and tight curves of the paper's."""
    return polar_lobes(30e-3, 10e-3, 4)


def machines(dt: float) -> dict[str, Plant]:
    """Machines of Fig. 13: as modelled, with Coulomb friction, with other parameters besides."""
    other = tuple(drive.scaled(HEAVIER, HEAVIER, WEAKER, WEAKER) for drive in (X_DRIVE, Y_DRIVE))
    return {
        "nominal": xy_table(dt),
        "friction": FrictionXYTable(dt),
        "mismatch": FrictionXYTable(dt, other),
    }


def traced(machine: Plant, contour: Contour, progress: float) -> tuple[Outcome, MPCC]:
    """MPCC with the paper's weights and this q_theta."""
    controller = MPCC(
        xy_table(PERIOD),
        contour,
        (-LARGEST_CURRENT, LARGEST_CURRENT),
        weights=ContouringWeights(progress=progress),
    )
    reference = along(contour, np.zeros(int(LONGEST / SAMPLE)), SAMPLE, 0, at_rest=True)
    return _driven(machine, controller, reference, contour), controller


def tracked(
    machine: Plant, contour: Contour, speed: float, weights: TrackingWeights = TRACKING
) -> Outcome:
    """MPTC, eq. 18, along a reference that runs at a constant speed from the first sample on."""
    controller = late_tracking(xy_table(PERIOD), weights, HORIZON, LARGEST_CURRENT)
    reference = at_speed(contour, speed, SAMPLE, controller.preview * round(PERIOD / SAMPLE))
    return _driven(machine, controller, reference, contour)


def cascaded(machine: Plant, contour: Contour, speed: float) -> Outcome:
    """Cascaded PI along the same reference, without computing delay.

    It acts, and the run is scored, once in the machine's sample period.
    """
    controller = Cascade(CASCADE[machine.dt], SENSORS, machine.dt, LARGEST_CURRENT)
    rollout = simulate(machine, controller, at_speed(contour, speed, machine.dt, 1))
    return Outcome(rollout, traversal_score(contour, rollout.output, machine.dt))


def _driven(
    machine: Plant, controller: HostController, reference: Reference, contour: Contour
) -> Outcome:
    try:
        run = reported_loop(machine, Held(controller, round(PERIOD / SAMPLE), 2), reference)
    except Stopped as stopped:  # scored as far as it came: its time says that it did not arrive
        run = stopped.run
    return Outcome(run.rollout, traversal_score(contour, run.rollout.output, SAMPLE))


def point(controller: str, plant: str, setting: str, outcome: Outcome, radius: float) -> Point:
    """One point of Fig. 13; `radius` is the largest of the contour [m]."""
    score = outcome.score
    arrived = bool(np.isfinite(score.time))
    return Point(controller, plant, setting, arrived, float(score.time), 100 * score.rms / radius)
