"""Controllers that keep to limits at every sample, as the commands see them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.machines.machine import Hosted, Machine
from experiments.options import Trace
from jcontour.controllers.lq.contouring_lq import LQWeights, Terminal
from jcontour.geometry.contour import Contour
from jcontour.host.controller import HostController
from jcontour.host.held import Held
from jcontour.host.observed import FilterGain, OffsetFreeGain
from jcontour.linear.plant import LinearPlant
from jcontour.mpc.contouring import MPCC
from jcontour.mpc.contouring_weights import ContouringWeights
from jcontour.mpc.forms import AbsoluteForm, OffsetFreeForm
from jcontour.mpc.limits import Limits
from jcontour.mpc.tracking import TrackingMPC, TrackingWeights
from jcontour.qp.solvers import Solver, solver_named

# steps: beyond it a QP takes seconds; the paper has 7, and 30 change little
LONGEST_HORIZON = 100
WEIGHTS = {  # field -> flag
    "contour_error": "q_contour",
    "lag": "q_lag",
    "progress": "q_theta",
    "control_change": "r_control",
    "speed_change": "r_speed",
}
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
    """

    machine: Machine
    hosted: Hosted
    contour: Contour
    mpcc: MPCC

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
    limit = _control_limit(machine, flags)
    if flags.horizon > LONGEST_HORIZON:
        raise ValueError(
            f"horizon: at most {LONGEST_HORIZON} steps, received {flags.horizon}: a longer one "
            "would not end within minutes; a longer --period-ms looks further ahead as well"
        )
    solver = solver_named(flags.solver)
    try:
        values: dict[str, Any] = {name: getattr(flags, flag) for name, flag in WEIGHTS.items()}
        mpcc = MPCC(
            hosted.model,
            contour,
            -limit,
            limit,
            1e-3 * flags.max_speed_mm_s,
            ContouringWeights(**values),
            flags.horizon,
            solver,
        )
    except ValueError as error:  # names the library's field: the user knows the flag
        field, _, fault = str(error).partition(":")
        raise ValueError(f"{FLAGS.get(field, field).replace('_', '-')}:{fault}") from None
    return Traverser(machine, hosted, contour, mpcc)


def _control_limit(machine: Machine, flags: Trace) -> np.ndarray:
    given = machine.limits.control if flags.max_control is None else flags.max_control
    if given is None:
        raise ValueError(f"max-control: {machine.name} states no limit on its controls; give one")
    limit = np.asarray(given, float)
    if not (np.isfinite(limit) & (limit > 0)).all():
        raise ValueError(f"max-control: needs to be finite and above zero, received {given}")
    return limit
