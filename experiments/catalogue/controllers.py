"""Names for the command line and for the contract tests: machines, plants, controllers, contours.

A newcomer adds one line here. `smooth`: derivatives agree with differences; `stable`: the closed loop, or the plant under a
controller, settles.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from experiments.axis_designs import axis_design
from experiments.designs import contouring_schemes as contouring
from experiments.designs import flexible_axis as laws
from experiments.designs import gantry as gantries
from experiments.designs.lq import contouring_lq, preview_lq
from experiments.jobs import contours
from experiments.jobs.job import TOOLPATHS, at_constant_feed, from_file
from experiments.jobs.motions import s_curve, task_a, task_b
from experiments.machines.flexible_axis import FlexibleMachine, biaxial_axes, biaxial_machine, thesis_machine
from experiments.machines.gantry import GantryMachine, friction_gantry_machine, gantry_machine, guide_ways
from experiments.machines.linear import LinearMachine, bridgeport_machine
from experiments.machines.machine import Machine
from jcontour.controllers.contouring.cross_coupled import ConstantCoupling, VariableCoupling
from jcontour.controllers.feedback.state_feedback import moving_target, quasi_steady_target
from jcontour.controllers.observers.extended_state_observers import NLESO, CurrentLESO, EulerLESO, ExactLESO
from jcontour.controllers.observers.kalman import PredictorObserver
from jcontour.geometry.contours import circle, ellipse, lemniscate
from jcontour.motion.input_shaping import zv
from jcontour.plants.bridgeport import bridgeport
from jcontour.plants.flexible_axis.axis import FlexibleAxis, SmoothFlexibleAxis, thesis_axis
from jcontour.plants.gantry.back_to_back_motors import servo_bench
from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry, StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.hardware_in_loop import HardwareInLoop
from jcontour.plants.gantry.parameters import thesis_gantry
from jcontour.plants.wrappers.wrapper import Delayed, Encoders, Quantised


class Entry(NamedTuple):
    """One thing with a name.

    Attributes:
        make: plants () -> Plant; controllers (name, machine, flags) -> Design; contours (pace) -> Job or Motion.
        line: what it is, in one line.
        smooth: differentiable where it is used.
        stable: its loop settles.
        still: a plant that stays where it is at rest without control.
        on: name of the machine that it is for, or of one of them; a controller is for all that have what `NEEDS` says of it.
    """

    make: Callable[..., Any]
    line: str
    smooth: bool = True
    stable: bool = True
    still: bool = True
    on: str = "bridgeport"


class Need(NamedTuple):
    """What a controller needs of a machine, in words, and whether one has it."""

    words: str
    met_by: Callable[[Machine], bool]


def _late(samples: int):
    return Delayed(bridgeport(), samples, 2, 2)


MACHINES: dict[str, Callable[[], Machine]] = {  # each under the name of one of the plants
    "bridgeport": bridgeport_machine,
    "flexible-axis": thesis_machine,
    "flexible-axes": biaxial_machine,
    "gantry": gantry_machine,
    "gantry-friction": friction_gantry_machine,
}

NEEDS = {  # of the controllers on each
    "bridgeport": Need("a machine given by A, B, C", lambda machine: isinstance(machine, LinearMachine)),
    "flexible-axis": Need("a flexible axis", lambda machine: isinstance(machine, FlexibleMachine)),
    "flexible-axes": Need(
        "two flexible axes or more, for a contour", lambda machine: isinstance(machine, FlexibleMachine) and len(machine.axes) > 1
    ),
    "gantry": Need("a gantry", lambda machine: isinstance(machine, GantryMachine)),
    "gantry-friction": Need(
        "a gantry with dry friction", lambda machine: isinstance(machine, GantryMachine) and machine.friction is not None
    ),
}

PLANTS = {
    "bridgeport": Entry(bridgeport, "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)", stable=False),
    "bridgeport-encoders": Entry(lambda: Encoders(bridgeport()), "the same, only its positions measured", stable=False),
    "bridgeport-late": Entry(lambda: _late(1), "the same under one sample of unmodelled delay", stable=False),
    "bridgeport-quantised": Entry(
        lambda: Quantised(Encoders(bridgeport()), 0.8e-6), "the same with encoder counts of 0.8 um", smooth=False, stable=False
    ),
    "flexible-axis": Entry(
        lambda: FlexibleAxis(thesis_axis(), 1e-3),
        "linear motor, spring and end effector, stick and slip, cogging (Yuan); tuned on its twin",
        smooth=False,
        on="flexible-axis",
    ),
    "flexible-axis-smooth": Entry(
        lambda: SmoothFlexibleAxis(thesis_axis(), 1e-3),
        "its smooth twin: dry friction turns within 1 mm/s, so that cogging makes it creep",
        still=False,
        on="flexible-axis",
    ),
    "flexible-axes": Entry(
        lambda: FlexibleAxis(biaxial_axes(), 1e-3), "two different flexible axes at right angles", smooth=False, on="flexible-axes"
    ),
    "gantry": Entry(
        lambda: Gantry(thesis_gantry(), 1e-3), "head on a beam that twists between its two drives (Yuan)", stable=False, on="gantry"
    ),
    "gantry-friction": Entry(
        lambda: StickSlipGantry(thesis_gantry(), guide_ways(), 1e-3),
        "the same with stick and slip in its three guide ways; tuned on its twin",
        smooth=False,
        stable=False,
        on="gantry-friction",
    ),
    "gantry-friction-smooth": Entry(
        lambda: SmoothFrictionGantry(thesis_gantry(), guide_ways(), 1e-3),
        "its smooth twin: dry friction turns within 1 mm/s",
        stable=False,
        on="gantry-friction",
    ),
    "gantry-hil": Entry(
        lambda: HardwareInLoop(Gantry(thesis_gantry(), 1e-3), servo_bench()),
        "the same with a motor bench as its head, one sample late: its twist grows unless the drives damp it; tuned on the gantry",
        smooth=False,
        stable=False,
        on="gantry",
    ),
}


def _on_axis(line: str, law: laws.Law, *gains: laws.Part) -> Entry:
    return Entry(axis_design(line, law, *gains), line, on="flexible-axis")


def _on_gantry(line: str, law: gantries.Law, part: gantries.Part, on: str = "gantry") -> Entry:
    return Entry(gantries.gantry_design(line, law, part), line, on=on)


def _on_axes(line: str, law: laws.Law, *gains: laws.Part) -> Entry:
    return Entry(axis_design(line, law, laws.loops, *gains), line, on="flexible-axes")


CONTROLLERS = {
    "contouring-lq": Entry(contouring_lq(), "receding-horizon LQ contouring, Kalman filter; --terminal chooses its end"),
    "contouring-lq-riccati": Entry(contouring_lq("riccati"), "the same with the Riccati terminal"),
    "contouring-lq-predictor": Entry(contouring_lq(observer=PredictorObserver), "the same with the predictor form of the observer"),
    "contouring-lq-state": Entry(contouring_lq(measured="state"), "the same fed the true state"),
    "contouring-lq-riccati-state": Entry(contouring_lq("riccati", "state"), "Riccati terminal, fed the true state"),
    "preview-lq": Entry(preview_lq(), "finite-preview LQ tracking (Tomizuka & Whitney), Kalman filter; beta unused"),
    "preview-lq-state": Entry(preview_lq("state"), "the same fed the true state"),
    "cascade": _on_axis("P position loop around a PI velocity loop", laws.cascade, laws.loops),
    "cascade-feedforward": _on_axis(
        "P-PI cascade fed what the motion needs: speed, inertia, viscous and dry friction", laws.cascade, laws.loops, laws.feedforward
    ),
    "cascade-notch": _on_axis("P-PI cascade through a notch", laws.with_notch(laws.cascade), laws.loops, laws.notched),
    "cascade-low-pass": _on_axis("P-PI cascade through a low pass", laws.with_low_pass(laws.cascade), laws.loops, laws.smoothed),
    "cascade-leso": _on_axis(
        "P-PI cascade with a linear extended state observer", laws.with_observer(laws.cascade, CurrentLESO), laws.loops, laws.rejection
    ),
    "cascade-leso-exact": _on_axis(
        "the same, its observer one sample late under zero-order hold",
        laws.with_observer(laws.cascade, ExactLESO),
        laws.loops,
        laws.rejection,
    ),
    "cascade-leso-euler": _on_axis("the same by forward Euler", laws.with_observer(laws.cascade, EulerLESO), laws.loops, laws.rejection),
    "cascade-nleso": _on_axis(
        "P-PI cascade with a nonlinear extended state observer",
        laws.with_observer(laws.cascade, NLESO),
        laws.loops,
        laws.rejection,
        laws.linear_range,
    ),
    "cascade-dob": _on_axis("P-PI cascade with a disturbance observer", laws.with_inverse(laws.cascade), laws.loops, laws.inverted),
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
        "linear-quadratic state feedback, Kalman filter, integral action", laws.integral_lqg, laws.state_weights, laws.integrated
    ),
    "lqg-offset-free": _on_axis(
        "linear-quadratic state feedback, Kalman filter that finds the load and cancels it",
        laws.behind_offset_free_filter(laws.quadratic(moving_target)),
        laws.state_weights,
        laws.drifting,
    ),
    "gantry-cascade": _on_gantry("P-PI cascade of each motor, fed speed and acceleration", gantries.cascade, gantries.loops),
    "gantry-friction-cascade": _on_gantry(
        "P-PI cascade of each motor, fed speed, acceleration and dry friction",
        gantries.cascade,
        gantries.loops_and_dry_friction,
        on="gantry-friction",
    ),
    "gantry-contouring-lq": _on_gantry(
        "contouring LQ on three motors, its model that of the beam's centre", gantries.contouring_lq, gantries.quadratic
    ),
    "gantry-scheduled-lq": _on_gantry(
        "contouring LQ on three motors, its models those along the path", gantries.scheduled_lq, gantries.quadratic
    ),
    "gantry-feedback-linearised-lq": _on_gantry(
        "the same, the coupling of head and beam cancelled by feedback (Yuan)", gantries.feedback_linearised_lq, gantries.quadratic
    ),
    "cross-coupled": _on_axes(
        "P-PI cascades with Koren's cross-coupled control, constant gains", contouring.cross_coupled(ConstantCoupling), contouring.coupled
    ),
    "cross-coupled-variable": _on_axes(
        "the same with variable gains (Koren & Lo)", contouring.cross_coupled(VariableCoupling), contouring.coupled
    ),
    "task-frame": _on_axes(
        "P-PI cascades, position gains along the path and across it", contouring.in_task_frame, contouring.along_and_across
    ),
    "precompensation": _on_axes(
        "P-PI cascades behind cross-coupled pre-compensation", contouring.behind_precompensation, contouring.precompensated
    ),
    "command-shaping": _on_axes(
        "P-PI cascades behind cross-coupled position command shaping", contouring.behind_shaping, contouring.shaped
    ),
}


def _along_the_beam(name: str, x: float, outline: contours.Outline) -> Entry:
    return Entry(contours.along_the_beam(name, x, outline), f"a tenth of a metre around {x:g} m on the gantry's beam", on="gantry")


CONTOURS = {
    "circle": Entry(lambda pace: at_constant_feed("circle", circle(1e-3), pace), "circle of 1 mm radius, constant feed"),
    "square": Entry(contours.square, "square of 2 mm, constant feed, corners and all"),
    "ellipse": Entry(lambda pace: at_constant_feed("ellipse", ellipse(3e-3, 1.5e-3), pace), "ellipse of 6 x 3 mm at constant feed"),
    "lemniscate": Entry(lambda pace: at_constant_feed("lemniscate", lemniscate(3e-3), pace), "figure of eight 6 mm wide, crosses itself"),
    "wave": Entry(contours.wave, "cubic spline through five points, open"),
    "bracket": Entry(lambda pace: from_file(TOOLPATHS / "bracket.ngc", pace), "bracket with fillets, holes and a slot, 12 x 8 mm, G-code"),
    "cam": Entry(lambda pace: from_file(TOOLPATHS / "cam.ngc", pace), "cam profile of a few hundred segments and arcs, G-code"),
    "ring": Entry(contours.ring, "circle of 25 mm radius, for flexible axes", on="flexible-axes"),
    "rounded-square": Entry(contours.rounded_square, "spline of 50 mm, for flexible axes", on="flexible-axes"),
    "ring-left": _along_the_beam("ring-left", -0.55, contours.ring_outline),
    "ring-centre": _along_the_beam("ring-centre", 0.0, contours.ring_outline),
    "cushion-left": _along_the_beam("cushion-left", -0.3, contours.cushion_outline),
    "oval-centre": _along_the_beam("oval-centre", 0.05, contours.oval_outline),
    "cushion-right": _along_the_beam("cushion-right", 0.4, contours.cushion_outline),
    "eight-right": _along_the_beam("eight-right", 0.7, contours.eight_outline),
    "task-a": Entry(task_a, "point to point, trapezoidal (Yuan)", on="flexible-axis"),
    "task-b": Entry(task_b, "to and fro along a cosine (Yuan)", on="flexible-axis"),
    "s-curve": Entry(s_curve, "point to point with limited jerk", on="flexible-axis"),
}
