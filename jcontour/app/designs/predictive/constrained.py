"""Controllers that keep to limits at every sample, as the commands see them."""

import numpy as np
from jaxtyping import ArrayLike

from jcontour.app.machines.machine import Machine
from jcontour.controllers.lq.contouring_lq import LQWeights, Terminal
from jcontour.geometry.contour import Contour
from jcontour.host.controller import HostController
from jcontour.host.late import OneSampleLate
from jcontour.host.observed import FilterGain, OffsetFreeGain
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import Reference, along
from jcontour.mpc.tracking.forms import AbsoluteForm, OffsetFreeForm, VelocityForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.qp.solvers import Solver

# steps: beyond it a QP takes seconds; the paper has 7, and 30 change little
LONGEST_HORIZON = 100
SETTLING = 1.0  # [s] that the tool is given after its reference has come to the end
FASTEST = 0.25  # [m/s] along the path: Lam's 1 mm per 4 ms
# R u_max^2: Lam's weight of 60 per A^2 on the change of currents that are limited to 0.5 A
CHANGE = 60.0 * 0.5**2


def limited_lq(
    model: LinearPlant,
    weights: LQWeights,
    preview: int,
    terminal: Terminal,
    observer: FilterGain | OffsetFreeGain | None,
    limits: Limits,
    solver: Solver,
) -> HostController:
    """Contouring LQ under limits, behind an observer; without one it is fed the state.

    Raises:
        ValueError: as `TrackingMPC` and the observer.
    """
    form = OffsetFreeForm() if isinstance(observer, OffsetFreeGain) else AbsoluteForm()
    tracking = TrackingMPC(
        model, TrackingWeights.of(weights), preview, limits, terminal, solver, form=form
    )
    return tracking if observer is None else observer.around(tracking, model)


def control_limit(machine: Machine) -> np.ndarray:
    """Limit on every control of the machine.

    Raises:
        ValueError: it states none.
    """
    if machine.limits.control is None:
        raise ValueError(f"plant: {machine.name} states no limit on its controls; give it one")
    return np.asarray(machine.limits.control, float)


def speed_limit(machine: Machine) -> float:
    """Highest path speed [m/s]: what every axis may run at, up to Lam's.

    No axis of a tool on its path runs faster; one that catches up with its path may.
    """
    axes = machine.limits.speed
    return FASTEST if axes is None else min(FASTEST, float(np.min(axes)))


def usual_change(machine: Machine) -> tuple[float, ...]:
    """Weight on the change of every control: a run uses as much of its limit as Lam's."""
    limit = np.broadcast_to(control_limit(machine), (machine.model.inputs,))
    return tuple((CHANGE / limit**2).tolist())


def late_tracking(
    model: LinearPlant, weights: TrackingWeights, horizon: int, limit: ArrayLike
) -> OneSampleLate:
    """Tracking MPC in the velocity form, eq. 18 of Lam et al., which answers one sample late.

    Args:
        model: without the delay that the controller brings.
        weights: of the cost.
        horizon: [samples].
        limit: on every control.
    """
    late, limits = with_input_delay(model, 1), Limits.within(control=limit)
    tracking = TrackingMPC(late, weights, horizon, limits, form=VelocityForm())
    return OneSampleLate(tracking, late)


def at_speed(contour: Contour, speed: float, dt: float, preview: int) -> Reference:
    """Reference for tracking controllers: full speed at once, then at rest at the end."""
    arc = constant_feed(contour, speed, dt)
    rest = np.full(int(SETTLING / dt), float(contour.length))
    return along(contour, np.append(arc, rest), dt, preview, at_rest=True)
