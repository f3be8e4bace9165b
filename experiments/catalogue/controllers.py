"""Names for the command line and for the contract tests: machines, plants, controllers, contours.

A newcomer adds one line here. `smooth`: derivatives agree with differences; `stable`: the closed
loop, or the plant under a controller, settles.
"""

from typing import TYPE_CHECKING

from experiments.catalogue.entries import Entry
from experiments.designs import contouring_schemes as contouring
from experiments.designs import flexible_axis as laws
from experiments.designs import gantry as gantries
from experiments.designs.flexible_axis import axis_design
from experiments.designs.lq import contouring_lq, preview_lq
from experiments.machines.machine import Machine
from experiments.options import Trace
from jcontour.controllers.contouring.cross_coupled import ConstantCoupling, VariableCoupling
from jcontour.controllers.feedback.state_feedback import moving_target, quasi_steady_target
from jcontour.controllers.observers.extended_state_observers import (
    NLESO,
    CurrentLESO,
    EulerLESO,
    ExactLESO,
)
from jcontour.controllers.observers.kalman import PredictorObserver
from jcontour.geometry.contour import Contour
from jcontour.motion.input_shaping import zv

if TYPE_CHECKING:
    from experiments.designs.constrained import Traverser


def _on_axis(line: str, law: laws.Law, *gains: laws.Part) -> Entry:
    return Entry(axis_design(line, law, *gains), line, on="flexible-axis")


def _on_gantry(line: str, law: gantries.Law, part: gantries.Part, on: str = "gantry") -> Entry:
    return Entry(gantries.gantry_design(line, law, part), line, on=on)


def _on_axes(line: str, law: laws.Law, *gains: laws.Part) -> Entry:
    return Entry(axis_design(line, law, laws.loops, *gains), line, on="flexible-axes")


def _traverser(machine: Machine, contour: Contour, flags: Trace) -> "Traverser":
    from experiments.designs.constrained import traverser  # the solvers take a second to import

    return traverser(machine, contour, flags)


CONSTRAINED = {  # on the host: they solve a QP at every sample
    "mpcc": Entry(
        _traverser,
        "model predictive contouring control (Lam), chooses its own speed: `jcontour trace`",
        on="xy-table",
    ),
}
CONTROLLERS = {
    "contouring-lq": Entry(
        contouring_lq(), "receding-horizon LQ contouring, Kalman filter; --terminal chooses its end"
    ),
    "contouring-lq-riccati": Entry(contouring_lq("riccati"), "the same with the Riccati terminal"),
    "contouring-lq-predictor": Entry(
        contouring_lq(observer=PredictorObserver),
        "the same with the predictor form of the observer",
    ),
    "contouring-lq-state": Entry(contouring_lq(fed="state"), "the same fed the true state"),
    "contouring-lq-riccati-state": Entry(
        contouring_lq("riccati", "state"), "Riccati terminal, fed the true state"
    ),
    "preview-lq": Entry(
        preview_lq(), "finite-preview LQ tracking (Tomizuka & Whitney), Kalman filter; beta unused"
    ),
    "preview-lq-state": Entry(preview_lq("state"), "the same fed the true state"),
    "cascade": _on_axis("P position loop around a PI velocity loop", laws.cascade, laws.loops),
    "cascade-feedforward": _on_axis(
        "P-PI cascade fed what the motion needs: speed, inertia, viscous and dry friction",
        laws.cascade,
        laws.loops,
        laws.feedforward,
    ),
    "cascade-notch": _on_axis(
        "P-PI cascade through a notch", laws.with_notch(laws.cascade), laws.loops, laws.notched
    ),
    "cascade-low-pass": _on_axis(
        "P-PI cascade through a low pass",
        laws.with_low_pass(laws.cascade),
        laws.loops,
        laws.smoothed,
    ),
    "cascade-leso": _on_axis(
        "P-PI cascade with a linear extended state observer",
        laws.with_observer(laws.cascade, CurrentLESO),
        laws.loops,
        laws.rejection,
    ),
    "cascade-leso-exact": _on_axis(
        "the same, its observer one sample late under zero-order hold",
        laws.with_observer(laws.cascade, ExactLESO),
        laws.loops,
        laws.rejection,
    ),
    "cascade-leso-euler": _on_axis(
        "the same by forward Euler",
        laws.with_observer(laws.cascade, EulerLESO),
        laws.loops,
        laws.rejection,
    ),
    "cascade-nleso": _on_axis(
        "P-PI cascade with a nonlinear extended state observer",
        laws.with_observer(laws.cascade, NLESO),
        laws.loops,
        laws.rejection,
        laws.linear_range,
    ),
    "cascade-dob": _on_axis(
        "P-PI cascade with a disturbance observer",
        laws.with_inverse(laws.cascade),
        laws.loops,
        laws.inverted,
    ),
    "pole-placement": _on_axis(
        "state feedback by its poles, moving target, reduced observer",
        laws.behind_reduced_observer(laws.placed(moving_target)),
        laws.poles,
    ),
    "lqr": _on_axis(
        "linear-quadratic state feedback, moving target, reduced observer",
        laws.behind_reduced_observer(laws.quadratic(moving_target)),
        laws.state_weights,
    ),
    "lqr-quasi-steady": _on_axis(
        "the same with the thesis's target, at rest wherever the reference is",
        laws.behind_reduced_observer(laws.quadratic(quasi_steady_target)),
        laws.state_weights,
    ),
    "cascade-zv": _on_axis(
        "P-PI cascade with feedforward behind a zero-vibration shaper",
        laws.with_shaper(laws.cascade, zv),
        laws.loops,
        laws.feedforward,
        laws.vibration,
    ),
    "lqg": _on_axis(
        "linear-quadratic state feedback, Kalman filter, integral action",
        laws.integral_lqg,
        laws.state_weights,
        laws.integrated,
    ),
    "lqg-offset-free": _on_axis(
        "linear-quadratic state feedback, Kalman filter that finds the load and cancels it",
        laws.behind_offset_free_filter(laws.quadratic(moving_target)),
        laws.state_weights,
        laws.drifting,
    ),
    "gantry-cascade": _on_gantry(
        "P-PI cascade of each motor, fed speed and acceleration", gantries.cascade, gantries.loops
    ),
    "gantry-friction-cascade": _on_gantry(
        "P-PI cascade of each motor, fed speed, acceleration and dry friction",
        gantries.cascade,
        gantries.loops_and_dry_friction,
        on="gantry-friction",
    ),
    "gantry-contouring-lq": _on_gantry(
        "contouring LQ on three motors, its model that of the beam's centre",
        gantries.contouring_lq,
        gantries.quadratic,
    ),
    "gantry-scheduled-lq": _on_gantry(
        "contouring LQ on three motors, its models those along the path",
        gantries.scheduled_lq,
        gantries.quadratic,
    ),
    "gantry-feedback-linearised-lq": _on_gantry(
        "the same, the coupling of head and beam cancelled by feedback (Yuan)",
        gantries.feedback_linearised_lq,
        gantries.quadratic,
    ),
    "cross-coupled": _on_axes(
        "P-PI cascades with Koren's cross-coupled control, constant gains",
        contouring.cross_coupled(ConstantCoupling),
        contouring.coupled,
    ),
    "cross-coupled-variable": _on_axes(
        "the same with variable gains (Koren & Lo)",
        contouring.cross_coupled(VariableCoupling),
        contouring.coupled,
    ),
    "task-frame": _on_axes(
        "P-PI cascades, position gains along the path and across it",
        contouring.in_task_frame,
        contouring.along_and_across,
    ),
    "precompensation": _on_axes(
        "P-PI cascades behind cross-coupled pre-compensation",
        contouring.behind_precompensation,
        contouring.precompensated,
    ),
    "command-shaping": _on_axes(
        "P-PI cascades behind cross-coupled position command shaping",
        contouring.behind_shaping,
        contouring.shaped,
    ),
}
