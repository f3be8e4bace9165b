"""Controllers that keep to limits at every sample, as the commands see them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from jcontour.app.flags.loops import Trace
from jcontour.app.machines.machine import Hosted, Machine
from jcontour.controllers.lq.contouring_lq import LQWeights, Terminal
from jcontour.geometry.contour import Contour
from jcontour.host.controller import HostController
from jcontour.host.held import Held
from jcontour.host.late import OneSampleLate
from jcontour.host.observed import FilterGain, OffsetFreeGain
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import Reference, along
from jcontour.mpc.contouring.contouring_weights import ContouringWeights
from jcontour.mpc.contouring.mpcc import MPCC
from jcontour.mpc.tracking.forms import AbsoluteForm, OffsetFreeForm, VelocityForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.qp.solvers import Solver, solver_named

# steps: beyond it a QP takes seconds; the paper has 7, and 30 change little
LONGEST_HORIZON = 100
SLOWEST = 0.02  # of the largest speed: a run that takes longer on average has stopped
SETTLING = 1.0  # [s] that the tool is given after its reference has come to the end
WEIGHTS = {  # field -> flag
    "contour_error": "q_contour",
    "lag": "q_lag",
    "progress": "q_theta",
    "control_change": "r_control",
    "speed_change": "r_speed",
}
FASTEST = 0.25  # [m/s] along the path: Lam's 1 mm per 4 ms
# R u_max^2: Lam's weight of 60 per A^2 on the change of currents that are limited to 0.5 A
CHANGE = 60.0 * 0.5**2
FLAGS = {**WEIGHTS, "speed_limit": "max_speed_mm_s", "lower, upper": "max_control"}


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


@dataclass(frozen=True)
class Traverser:
    """A controller that chooses its own speed along one contour, and what it drives.

    Attributes:
        machine: of the catalogue or a file.
        hosted: the plant and the model of the controller.
        contour: the path.
        mpcc: the controller at its own period.
        speed_limit: of the path [m/s].
    """

    machine: Machine
    hosted: Hosted
    contour: Contour
    mpcc: MPCC
    speed_limit: float

    @property
    def controller(self) -> Held:
        """The controller in a loop of the plant's sample period."""
        return Held(self.mpcc, self.hosted.every, self.mpcc.model.inputs)


def traverser(machine: Machine, contour: Contour, flags: Trace) -> Traverser:
    """Model predictive contouring control with the flags' weights.

    Raises:
        ValueError: a flag is wrong, named as the user knows it, or the machine states no limit on
            its controls and the flags give none.
    """
    hosted = machine.hosted(None if flags.period_ms is None else 1e-3 * flags.period_ms)
    limit = control_limit(machine, flags.max_control)
    if flags.horizon > LONGEST_HORIZON:
        raise ValueError(
            f"horizon: at most {LONGEST_HORIZON} steps, received {flags.horizon}: a longer one "
            "would not end within minutes; a longer --period-ms looks further ahead as well"
        )
    solver, speed = solver_named(flags.solver), speed_limit(machine, flags.max_speed_mm_s)
    values: dict[str, Any] = {name: getattr(flags, flag) for name, flag in WEIGHTS.items()}
    if flags.r_control is None:
        values["control_change"] = usual_change(machine, limit)
    try:
        mpcc = MPCC(
            hosted.model,
            contour,
            -limit,
            limit,
            speed,
            ContouringWeights(**values),
            flags.horizon,
            solver,
        )
    except ValueError as error:  # names the library's field: the user knows the flag
        field, _, fault = str(error).partition(":")
        raise ValueError(f"{FLAGS.get(field, field).replace('_', '-')}:{fault}") from None
    return Traverser(machine, hosted, contour, mpcc, speed)


def control_limit(machine: Machine, given: float | None = None) -> np.ndarray:
    """Limit on every control: the given one, or the machine's own.

    Raises:
        ValueError: it is not above zero, or there is neither.
    """
    limit = machine.limits.control if given is None else given
    if limit is None:
        raise ValueError(f"max-control: {machine.name} states no limit on its controls; give one")
    found = np.asarray(limit, float)
    if not (np.isfinite(found) & (found > 0)).all():
        raise ValueError(f"max-control: needs to be finite and above zero, received {limit}")
    return found


def speed_limit(machine: Machine, given_mm_s: float | None = None) -> float:
    """Highest path speed [m/s]: the given one [mm/s], or what every axis may run at, up to Lam's.

    No axis of a tool on its path runs faster; one that catches up with its path may.
    """
    if given_mm_s is not None:
        return 1e-3 * given_mm_s
    axes = machine.limits.speed
    return FASTEST if axes is None else min(FASTEST, float(np.min(axes)))


def usual_change(machine: Machine, limit: np.ndarray) -> tuple[float, ...]:
    """Weight on the change of every control, where none is given: a run uses as much of its limit.

    Args:
        machine: its own limits count where it has some.
        limit: on every control, otherwise.
    """
    own = limit if machine.limits.control is None else np.asarray(machine.limits.control, float)
    return tuple((CHANGE / np.broadcast_to(own, (machine.model.inputs,)) ** 2).tolist())


def waiting_reference(asked: Traverser) -> Reference:
    """The start of the path, for as long as a run may take whose controller chooses its speed."""
    dt, slowest = asked.hosted.plant.dt, SLOWEST * asked.speed_limit
    steps = int(float(asked.contour.length) / slowest / dt) + 1
    return along(asked.contour, np.zeros(steps), dt, 0, at_rest=True)


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
