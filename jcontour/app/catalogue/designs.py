"""Makers of the catalogue's designs, a table for each kind of machine.

A table is imported when one of its designs is made.
"""

from collections.abc import Mapping
from functools import cache

from jcontour.app.catalogue.entries import MakeDesign


@cache
def lq_designs() -> Mapping[str, MakeDesign]:
    """Receding-horizon LQ on a machine given by A, B, C."""
    from jcontour.app.designs.lq.constrained_lq import constrained_lq
    from jcontour.app.designs.lq.receding_horizon import blockwise_lq, contouring_lq, preview_lq

    return {
        "contouring-lq": contouring_lq(),
        "contouring-lq-riccati": contouring_lq("riccati"),
        "contouring-lq-kalman": contouring_lq(observer="filter"),
        "contouring-lq-predictor": contouring_lq(observer="predictor"),
        "contouring-lq-state": contouring_lq(fed="state"),
        "contouring-lq-riccati-state": contouring_lq("riccati", "state"),
        "contouring-lq-blocks": blockwise_lq(),
        "constrained-lq": constrained_lq,
        "preview-lq": preview_lq(),
        "preview-lq-state": preview_lq("state"),
    }


@cache
def linear_feedforward_designs() -> Mapping[str, MakeDesign]:
    """Cascades on a machine given by A, B, C, and inverse feedforward in front of them."""
    from jcontour.app.designs import adaptive, feedforward
    from jcontour.app.designs import simple_loops as simple

    design = feedforward.feedforward_design
    return {
        "linear-cascade": design(feedforward.Plain),
        "linear-cascade-feedforward": simple.simple_design(simple.proportional_integral),
        "linear-cascade-notch": simple.simple_design(simple.notched(simple.proportional_integral)),
        "position-loop": simple.simple_design(simple.proportional),
        "position-loop-notch": simple.simple_design(simple.notched(simple.proportional)),
        "zpetc": design(feedforward.ZeroPhase),
        "optimal-feedforward": design(feedforward.Optimal),
        "repetitive": design(adaptive.Repeating),
        "run-out": design(adaptive.RunOut),
        "adaptive-zpetc": adaptive.adaptive_zero_phase,
    }


@cache
def flexible_axis_designs() -> Mapping[str, MakeDesign]:
    """Cascades and state feedback on flexible axes."""
    from jcontour.app.designs import flexible_axis as axis
    from jcontour.app.designs import motor_feedforward as ahead
    from jcontour.controllers.feedback.state_feedback import moving_target, quasi_steady_target
    from jcontour.controllers.observers import extended_state_observers as observers
    from jcontour.motion.input_shaping import zv

    def rejecting(observer: type[observers.ExtendedStateObserver], *gains: axis.GainSet):
        make = axis.with_observer(axis.cascade, observer)
        return axis.axis_design(make, axis.loops, axis.rejection, *gains)

    def observed(make: axis.MakeController, gains: axis.GainSet):
        return axis.axis_design(axis.behind_reduced_observer(make), gains)

    offset_free = axis.behind_offset_free_filter(axis.quadratic(moving_target))
    shaped = axis.with_shaper(axis.cascade, zv)
    return {
        "cascade": axis.axis_design(axis.cascade, axis.loops),
        "cascade-feedforward": axis.axis_design(axis.cascade, axis.loops, axis.feedforward),
        "cascade-notch": axis.axis_design(axis.with_notch(axis.cascade), axis.loops, axis.notched),
        "cascade-low-pass": axis.axis_design(
            axis.with_low_pass(axis.cascade), axis.loops, axis.smoothed
        ),
        "cascade-leso": rejecting(observers.CurrentLESO),
        "cascade-leso-exact": rejecting(observers.ExactLESO),
        "cascade-leso-euler": rejecting(observers.EulerLESO),
        "cascade-nleso": rejecting(observers.NLESO, axis.linear_range),
        "cascade-dob": axis.axis_design(axis.with_inverse(axis.cascade), axis.loops, axis.inverted),
        "time-delay": axis.axis_design(axis.time_delay, axis.delayed),
        "pole-placement": observed(axis.placed(moving_target), axis.poles),
        "lqr": observed(axis.quadratic(moving_target), axis.state_weights),
        "lqr-quasi-steady": observed(axis.quadratic(quasi_steady_target), axis.state_weights),
        "cascade-zv": axis.axis_design(shaped, axis.loops, axis.feedforward, axis.vibration),
        "lqg": axis.axis_design(axis.integral_lqg, axis.state_weights, axis.integrated),
        "lqg-offset-free": axis.axis_design(offset_free, axis.state_weights, axis.drifting),
        "flexible-zpetc": ahead.axes_feedforward(ahead.zero_phase),
        "flexible-optimal-feedforward": ahead.axes_feedforward(ahead.optimal),
    }


@cache
def contouring_scheme_designs() -> Mapping[str, MakeDesign]:
    """Contouring schemes around the cascades of several flexible axes."""
    from jcontour.app.designs import contouring_schemes as schemes
    from jcontour.app.designs.flexible_axis import axis_design, loops
    from jcontour.app.designs.synchronised import axes_design
    from jcontour.controllers.contouring.cross_coupled import ConstantCoupling, VariableCoupling

    constant = schemes.cross_coupled(ConstantCoupling)
    variable = schemes.cross_coupled(VariableCoupling)
    return {
        "cross-coupled": axis_design(constant, loops, schemes.coupled),
        "cross-coupled-variable": axis_design(variable, loops, schemes.coupled),
        "task-frame": axis_design(schemes.in_task_frame, loops, schemes.along_and_across),
        "precompensation": axis_design(
            schemes.behind_precompensation, loops, schemes.precompensated
        ),
        "command-shaping": axis_design(schemes.behind_shaping, loops, schemes.shaped),
        "synchronised": axes_design,
    }


@cache
def gantry_designs() -> Mapping[str, MakeDesign]:
    """Cascades and contouring LQ on gantries."""
    from jcontour.app.designs import adaptive, gantry, gantry_observer, synchronised
    from jcontour.app.designs import motor_feedforward as ahead

    design, quadratic = gantry.gantry_design, gantry.quadratic
    return {
        "gantry-cascade": design(gantry.cascade, gantry.loops),
        "gantry-friction-cascade": design(gantry.cascade, gantry.loops_and_dry_friction),
        "gantry-contouring-lq": design(gantry.contouring_lq, quadratic),
        "gantry-scheduled-lq": design(gantry.scheduled_lq, quadratic),
        "gantry-feedback-linearised-lq": design(gantry.feedback_linearised_lq, quadratic),
        "gantry-offset-free-lq": gantry_observer.offset_free_design,
        "gantry-synchronised": design(synchronised.both_drives, synchronised.loops_of_drives),
        "gantry-self-tuning": adaptive.self_tuning,
        "gantry-zpetc": ahead.drives_feedforward(ahead.zero_phase),
        "gantry-optimal-feedforward": ahead.drives_feedforward(ahead.optimal),
    }
