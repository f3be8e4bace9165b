"""Controllers with a quadratic program at every sample, as the commands see them.

MPCC and tracking MPC run on the host, one run at a time: a design is weights, a horizon and a
speed. Contouring LQ under limits is checked with the weights of the tuned controller.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from jcontour.app.machines.machine import Machine
from jcontour.controllers.lq.contouring_lq import LQWeights, Terminal
from jcontour.geometry.contour import Contour
from jcontour.host.controller import HostController
from jcontour.host.held import Held, OneSampleLate
from jcontour.host.observed import ObservedHost, OffsetFreeHost
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import Reference, along
from jcontour.mpc.contouring.contouring_qp import ContouringWeights
from jcontour.mpc.contouring.mpcc import MPCC
from jcontour.mpc.tracking.forms import AbsoluteForm, OffsetFreeForm, VelocityForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.plant import Plant
from jcontour.qp.solvers import Solver

# steps: beyond it a QP takes seconds; the paper has 7, and 30 change little
LONGEST_HORIZON = 100
SETTLING = 1.0  # [s] that the tool is given after its reference has come to the end
FASTEST = 0.25  # [m/s] along the path: Lam's 1 mm per 4 ms
# R u_max^2: Lam's weight of 60 per A^2 on the change of currents that are limited to 0.5 A
CHANGE = 60.0 * 0.5**2
SLOWEST = 0.02  # of the largest speed: a run that takes longer on average has stopped
FIELDS = {  # field of the library -> weight of the command line
    "contour_error": "q_contour",
    "lag": "q_lag",
    "progress": "q_theta",
    "control_change": "r_control",
    "speed_change": "r_speed",
}


def limited_lq(
    model: LinearPlant,
    weights: LQWeights,
    preview: int,
    terminal: Terminal,
    limits: Limits,
    solver: Solver,
    gain: np.ndarray | None = None,
    offset_free: bool = False,
) -> HostController:
    """Contouring LQ under limits, behind an observer of a gain; without one it is fed the state."""
    form = OffsetFreeForm() if offset_free else AbsoluteForm()
    tracking = TrackingMPC(
        model, TrackingWeights.of(weights), preview, limits, terminal, solver, form=form
    )
    if gain is None:
        return tracking
    if offset_free:
        return OffsetFreeHost(tracking, model, gain, model.C)
    return ObservedHost(tracking, model, gain)


def control_limit(machine: Machine) -> np.ndarray:
    """Limit on every control of the machine."""
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


class PredictiveDesign(NamedTuple):
    """One design."""

    weights: Mapping[str, float]  # by name; those that are not named have their usual values
    horizon: int  # steps of the controller that it looks ahead
    speed_mm_s: float  # along the path [mm/s]; the highest one where the controller chooses it


class HostedRun(NamedTuple):
    """A run that is ready to begin."""

    plant: Plant  # as it is
    controller: Held  # in a loop of the plant's sample period
    reference: Reference  # where the tool should be, or how long the run may take
    # arc length at which the controller holds the tool to be, from its memories [m]; None where it
    # holds none
    progress: Callable[[Any], Any] | None


def _contouring(machine: Machine, contour: Contour, design: PredictiveDesign) -> HostedRun:
    """Model predictive contouring control; the reference is the time that a run may take."""
    hosted, limit = machine.hosted(), control_limit(machine)
    speed = 1e-3 * design.speed_mm_s
    values: dict[str, Any] = {field: design.weights.get(name) for field, name in FIELDS.items()}
    if values["control_change"] is None:
        values["control_change"] = usual_change(machine)
    try:
        costs = ContouringWeights(**values)
        mpcc = MPCC(hosted.model, contour, (-limit, limit), speed, costs, design.horizon)
    except ValueError as error:  # names the library's field: the user knows the weight
        field, _, fault = str(error).partition(":")
        raise ValueError(f"{FIELDS.get(field, field)}:{fault}") from None
    held, dt = Held(mpcc, hosted.every, mpcc.model.inputs), hosted.plant.dt
    steps = int(float(contour.length) / (SLOWEST * speed) / dt) + 1
    waiting = along(contour, np.zeros(steps), dt, 0, at_rest=True)
    return HostedRun(hosted.plant, held, waiting, lambda memory: mpcc.arc(memory.inner))


def _tracking(machine: Machine, contour: Contour, design: PredictiveDesign) -> HostedRun:
    """Tracking MPC along the path at one speed."""
    limit, hosted = control_limit(machine), machine.hosted()
    weights = TrackingWeights(**{"increment": usual_change(machine), **dict(design.weights)})
    late = late_tracking(hosted.model, weights, design.horizon, limit)
    held = Held(late, hosted.every, hosted.model.inputs)
    speed, dt = 1e-3 * design.speed_mm_s, hosted.plant.dt
    return HostedRun(hosted.plant, held, at_speed(contour, speed, dt, held.preview), None)


class PredictiveKind(NamedTuple):
    """A kind of predictive controller."""

    # run of a design along a contour of a machine
    make: Callable[[Machine, Contour, PredictiveDesign], HostedRun]
    # its weights by name: value where nothing is said, None for the machine's
    weights: Mapping[str, float | None]
    share: float  # of the machine's `speed_limit`, where no speed is given

    def hosted(self, machine: Machine, contour: Contour, design: PredictiveDesign) -> HostedRun:
        """The run of a design."""
        if not 1 <= design.horizon <= LONGEST_HORIZON:
            raise ValueError(
                f"preview: needs 1 to {LONGEST_HORIZON} steps, received {design.horizon}"
            )
        usual = {name: value for name, value in self.weights.items() if value is not None}
        return self.make(machine, contour, design._replace(weights={**usual, **design.weights}))


PREDICTIVE: Mapping[str, PredictiveKind] = {
    "mpcc": PredictiveKind(
        _contouring,
        {
            "q_theta": 0.3,  # [1/mm] the middle of the paper's range; the others are the paper's
            "q_contour": 100.0,  # [1/mm^2]
            "q_lag": 200.0,  # [1/mm^2]
            "r_control": None,  # [1/control unit^2]
            "r_speed": 200.0,  # [1/(mm per step)^2]
        },
        1.0,
    ),
    "tracking-mpc": PredictiveKind(
        _tracking,
        {
            "output": 1e8,  # [1/m^2] Q_t and R_t are not printed: MPCC's own
            "contour": 0.0,  # [1/m^2]
            "increment": None,  # [1/control unit^2]
        },
        0.4,  # section 5 has 50 to 150 mm/s on a table of 250 mm/s
    ),
}
