"""Predictive controllers with a quadratic program at every sample: one run, or a sweep of designs.

A design is weights, a horizon and a speed. A `Case` makes of it what the loop on the host needs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from jcontour.app.designs.predictive.constrained import (
    LONGEST_HORIZON,
    at_speed,
    control_limit,
    late_tracking,
    speed_limit,
    usual_change,
)
from jcontour.app.machines.machine import Machine
from jcontour.geometry.contour import Contour
from jcontour.host.held import Held
from jcontour.motion.references import Reference, along
from jcontour.mpc.contouring.contouring_weights import ContouringWeights
from jcontour.mpc.contouring.mpcc import MPCC
from jcontour.mpc.tracking.tracking_mpc import TrackingWeights
from jcontour.plant import Plant

SLOWEST = 0.02  # of the largest speed: a run that takes longer on average has stopped
WEIGHTS = {  # field of the library -> weight
    "contour_error": "q_contour",
    "lag": "q_lag",
    "progress": "q_theta",
    "control_change": "r_control",
    "speed_change": "r_speed",
}


class PredictiveDesign(NamedTuple):
    """One design.

    Attributes:
        weights: by name; those that are not named have their usual values.
        horizon: steps of the controller that it looks ahead.
        speed_mm_s: along the path [mm/s]; the highest one where the controller chooses it.
    """

    weights: Mapping[str, float]
    horizon: int
    speed_mm_s: float


class HostedRun(NamedTuple):
    """A run that is ready to begin.

    Attributes:
        plant: as it is.
        controller: in a loop of the plant's sample period.
        reference: where the tool should be, or how long the run may take.
        progress: arc length at which the controller holds the tool to be, from its memories [m];
            None where it holds none.
    """

    plant: Plant
    controller: Held
    reference: Reference
    progress: Callable[[Any], Any] | None


@dataclass(frozen=True)
class Case:
    """What all designs of a sweep along one contour have in common; another process can have it."""

    controller: str
    machine: Machine
    contour: Contour

    def hosted(self, design: PredictiveDesign) -> HostedRun:
        """The run of a design.

        Raises:
            ValueError: a weight, the horizon or the speed is wrong, or the machine states no limit
                on its controls.
        """
        kind = PREDICTIVE[self.controller]
        usual = {name: value for name, (value, _) in kind.weights.items() if value is not None}
        return kind.make(self, design._replace(weights={**usual, **design.weights}))


class PredictiveKind(NamedTuple):
    """A kind of predictive controller.

    Attributes:
        make: run of a design.
        weights: its weights by name: value where nothing is said, None for the machine's, and
            unit.
        varied: the one weight that varies on a machine where none is named, and its values.
        speeds_mm_s: on a machine, where none are named.
    """

    make: Callable[[Case, PredictiveDesign], HostedRun]
    weights: Mapping[str, tuple[float | None, str]]
    varied: Callable[[Machine], tuple[str, tuple[float, ...]]]
    speeds_mm_s: Callable[[Machine], tuple[float, ...]]


def _contouring(case: Case, design: PredictiveDesign) -> HostedRun:
    """Model predictive contouring control; the reference is the time that a run may take."""
    hosted, limit = case.machine.hosted(), control_limit(case.machine)
    speed, weights = 1e-3 * design.speed_mm_s, dict(design.weights)
    values: dict[str, Any] = {field: weights.get(name) for field, name in WEIGHTS.items()}
    if values["control_change"] is None:
        values["control_change"] = usual_change(case.machine)
    horizon = _checked(design.horizon)
    try:
        costs = ContouringWeights(**values)
        mpcc = MPCC(hosted.model, case.contour, -limit, limit, speed, costs, horizon)
    except ValueError as error:  # names the library's field: the user knows the weight
        field, _, fault = str(error).partition(":")
        raise ValueError(f"{WEIGHTS.get(field, field)}:{fault}") from None
    held, dt = Held(mpcc, hosted.every, mpcc.model.inputs), hosted.plant.dt
    steps = int(float(case.contour.length) / (SLOWEST * speed) / dt) + 1
    waiting = along(case.contour, np.zeros(steps), dt, 0, at_rest=True)
    return HostedRun(hosted.plant, held, waiting, lambda memory: mpcc.arc(memory.inner))


def _checked(horizon: int) -> int:
    if not 1 <= horizon <= LONGEST_HORIZON:
        raise ValueError(f"preview: needs 1 to {LONGEST_HORIZON} steps, received {horizon}")
    return horizon


def _tracking(case: Case, design: PredictiveDesign) -> HostedRun:
    """Tracking MPC along the path at one speed."""
    limit, hosted = control_limit(case.machine), case.machine.hosted()
    weights = TrackingWeights(**{"increment": usual_change(case.machine), **dict(design.weights)})
    late = late_tracking(hosted.model, weights, _checked(design.horizon), limit)
    held = Held(late, hosted.every, hosted.model.inputs)
    speed, dt = 1e-3 * design.speed_mm_s, hosted.plant.dt
    return HostedRun(hosted.plant, held, at_speed(case.contour, speed, dt, held.preview), None)


def _changes(machine: Machine) -> tuple[float, ...]:
    """A decade around the usual weight on the change of the controls, as one number for all."""
    middle = np.exp(np.mean(np.log(usual_change(machine))))
    return tuple(float(f"{factor * middle:.6g}") for factor in (0.1, 1.0, 10.0))


def _speeds(machine: Machine) -> tuple[float, ...]:
    """Section 5 has 50 to 150 mm/s on a table of 250 mm/s: as large a part of a machine's own."""
    fastest = 1e3 * speed_limit(machine)
    return tuple(round(share * fastest, 6) for share in (0.2, 0.3, 0.4, 0.5, 0.6))


PREDICTIVE: Mapping[str, PredictiveKind] = {
    "mpcc": PredictiveKind(
        _contouring,
        {
            "q_theta": (0.3, "1/mm"),  # the middle of the paper's range; the others are the paper's
            "q_contour": (100.0, "1/mm^2"),
            "q_lag": (200.0, "1/mm^2"),
            "r_control": (None, "1/control unit^2"),
            "r_speed": (200.0, "1/(mm per step)^2"),
        },
        lambda _: ("q_theta", (0.03, 0.1, 0.3, 1.0, 5.0)),  # the paper's range
        lambda machine: (1e3 * speed_limit(machine),),
    ),
    "tracking-mpc": PredictiveKind(
        _tracking,
        {
            "output": (1e8, "1/m^2"),  # Q_t and R_t are not printed: MPCC's own
            "contour": (0.0, "1/m^2"),
            "increment": (None, "1/control unit^2"),
        },
        lambda machine: ("increment", _changes(machine)),
        _speeds,
    ),
}
