"""Figs 4.3 to 4.5: the point-to-point motion under the thesis's other controllers, as printed.

The thesis simulates them on its identified axis. What it does not print is assumed: the notch's
frequency is that of section 3.4.2, the MPC's horizon is ours, its state is known, and a run lasts
2 s. Its own bounded controller cannot be run: the printed data admit no set.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import RiccatiTerminal
from jcontour.controllers.wrappers.filters import Filtered, notch
from jcontour.geometry.contours import line
from jcontour.host.loop import reported_loop
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import Reference, in_time
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.plants import thesis_axis
from jcontour.plants.flexible_axis.axis import FlexibleAxis
from jcontour.plants.flexible_axis.models import euler_model
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate
from jcontour.wrapper import Wrapper

CASCADE = CascadeGains(30.0, 38.21, 0.04)  # k_pp [1/s], k_pv [As/m], T_iv [s], section 4.3.2
NOTCH = (87.0, 0.80, 0.18)  # frequency [rad/s] of section 3.4.2; gain and damping in print
PERIODS = {"1 kHz": 1e-3, "4 kHz": 0.25e-3}  # [s]
STANDARD, RETUNED = (1.0, 5e-5), (1e5, 0.4)  # Q_1 on the end effector's error, R_1
HORIZON = 30  # [samples], not printed: 10 to 60 change no verdict
CURRENT = 9.0  # [A]
WAITING, DURATION = 0.2, 2.0  # [s], of Fig. 4.2, and of a run


@dataclass(frozen=True)
class PointToPointRun:
    """Tracking error of the end effector under one controller."""

    controller: str
    period_s: float
    largest_mm: float
    mean_mm: float
    error_mm: Float[np.ndarray, " T"]


class KnownState(Wrapper):
    """A flexible axis whose whole state (x_m, v_m, x_e, v_e) is measured."""

    def measure(self, state) -> Float[Array, "4"]:
        """Position and speed of motor and end effector."""
        x = state.motion
        return jnp.concatenate([x.motor, x.motor_speed, x.tool, x.tool_speed])


def motion(dt: float, preview: int) -> Reference:
    """0.1 m at 0.1 m/s and 4 m/s^2, after 0.2 s at rest."""
    law = PointToPoint(0.1, 0.1, 4.0)
    return in_time(line([0.0], [0.1]), law, DURATION, dt, preview, dwell=WAITING)


def point_to_point() -> tuple[PointToPointRun, ...]:
    """The cascade at two rates, and the standard MPC with its two weights."""
    runs = []
    for rate, dt in PERIODS.items():
        cascade = Filtered(Cascade(CASCADE, motors(1), dt, CURRENT), notch(*NOTCH, dt), 1)
        reference = motion(dt, 1)
        output = simulate(FlexibleAxis(thesis_axis(), dt), cascade, reference).output
        runs.append(_run(f"cascaded PI, {rate}", reference, output))
    dt = PERIODS["1 kHz"]
    model, limits = euler_model(thesis_axis(), dt), Limits.within(control=CURRENT)
    reference, plant = motion(dt, HORIZON), KnownState(FlexibleAxis(thesis_axis(), dt))
    for name, (Q, R) in (("standard MPC", STANDARD), ("standard MPC, retuned", RETUNED)):
        weights = TrackingWeights(Q, control=R)
        mpc = TrackingMPC(model, weights, HORIZON, limits, RiccatiTerminal())
        output = reported_loop(plant, mpc, reference).rollout.output
        runs.append(_run(name, reference, output))
    return tuple(runs)


def _run(name: str, reference: Reference, output: Float[Array, "T 1"]) -> PointToPointRun:
    error = 1e3 * (np.asarray(reference.position)[: len(output), 0] - np.asarray(output)[:, 0])
    size = np.abs(error)
    return PointToPointRun(name, reference.dt, float(size.max()), float(size.mean()), error)
