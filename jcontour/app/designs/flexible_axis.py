"""Controllers of flexible axes, built from gains.

They are the cascade with its parts around it, and state feedback behind its observers. Every part
names its gains once, where they start and where they may go. Every controller takes all of them by
name.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.designs.gains import Gain, GainDesign, Gains
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.flexible_axis import FlexibleMachine
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.integral_lqg import IntegralLQG, integral_lq_gains, positions_of
from jcontour.controllers.feedback.pole_placement import damped_poles, placed_gain
from jcontour.controllers.feedback.state_feedback import (
    StateFeedback,
    SteadyTarget,
    lq_gain,
    moving_target,
)
from jcontour.controllers.feedback.time_delay import TimeDelayControl
from jcontour.controllers.observers.disturbance_observer import DisturbanceObserver
from jcontour.controllers.observers.extended_state_observers import (
    NLESO,
    DisturbanceRejection,
    ExtendedStateObserver,
)
from jcontour.controllers.observers.kalman import OffsetFreeObserver, kalman_gain, offset_free_gain
from jcontour.controllers.observers.reduced_observer import ReducedObserver, thesis_gain
from jcontour.controllers.wrappers.filters import Filtered, low_pass, notch
from jcontour.controllers.wrappers.shaped import Shaped
from jcontour.linear.plant import LinearPlant
from jcontour.motion.input_shaping import Shaper
from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.sensors import motors
from tuning.parameters import Interval

# of damping: poles stay complex, and Ackermann's formula well conditioned
RATIO = Interval(0.02, 0.98)
SPEED_NOISE = 1e-3  # [m/s] of the drive's speed, as the Kalman filter takes it
CONTROL_NOISE = 0.1  # [A] of what the model does not know, as it changes from sample to sample

GainSet = Callable[[FlexibleMachine], dict[str, Gain]]
MakeController = Callable[[FlexibleMachine, Gains], Controller]


def loops(machine: FlexibleMachine) -> dict[str, Gain]:
    """Gains of the thesis's cascade, section 3.4.2.

    The velocity loop of another axis is as fast as that of the thesis's axis.
    """
    velocity = 55.67 * _heaviness(machine) / _heaviness(None)
    return {
        "position": Gain(30.0, "1/s"),
        "velocity": Gain(_number(velocity), "A s/m"),
        "integral_time": Gain(0.04, "s"),
    }


def feedforward(machine: FlexibleMachine) -> dict[str, Gain]:
    """Feedforward gains by the model."""
    p = machine.parameters
    dry = (p.friction.coulomb + p.friction.stribeck) / p.force_constant
    return {
        "feedforward": Gain(1.0, ""),
        "inertia": Gain(_number(_heaviness(machine)), "A s^2/m"),
        "viscous": Gain(_number(p.friction.viscous / p.force_constant), "A s/m"),
        "coulomb": Gain(_number(dry), "A"),
    }


def notched(machine: FlexibleMachine) -> dict[str, Gain]:
    """The thesis's notch, section 3.4.2."""
    return {
        "notch": Gain(87.0, "rad/s", _below_nyquist(machine)),
        "depth": Gain(0.85, ""),
        "notch_damping": Gain(0.05, ""),
    }


def smoothed(machine: FlexibleMachine) -> dict[str, Gain]:
    """A low pass a decade above the velocity loop."""
    return {
        "low_pass": Gain(1000.0, "rad/s", _below_nyquist(machine)),
        "low_pass_damping": Gain(np.sqrt(0.5), ""),
    }


def rejection(machine: FlexibleMachine) -> dict[str, Gain]:
    """The thesis's extended state observer, section 3.4.2; forward Euler is stable up to 2 / dt."""
    return {"bandwidth": Gain(700.0, "rad/s", Interval(1.0, 1.9 / machine.model.dt))}


def linear_range(machine: FlexibleMachine) -> dict[str, Gain]:
    """Errors beyond ten encoder counts are weighed less."""
    return {"delta": Gain(10 * machine.encoder_resolution, "m")}


def inverted(machine: FlexibleMachine) -> dict[str, Gain]:
    """A disturbance observer somewhat faster than the velocity loop."""
    return {"bandwidth": Gain(100.0, "rad/s", Interval(1.0, 1.0 / machine.model.dt))}


def poles(machine: FlexibleMachine) -> dict[str, Gain]:
    """A rigid pair as fast as the thesis's velocity loop, and the link's own, damped."""
    return {
        "rigid": Gain(60.0, "rad/s"),
        "rigid_damping": Gain(0.9, "", RATIO),
        "link": Gain(_link_frequency(machine), "rad/s"),
        "link_damping": Gain(0.1, "", RATIO),
    }


def state_weights(machine: FlexibleMachine) -> dict[str, Gain]:
    """Diagonal of Q beside R = 1 / A^2.

    An ampere weighs as much as 0.3 mm of the motor or the tool, or as 20 mm/s of the motor.
    """
    return {
        "motor": Gain(1e7, "A^2/m^2", cost=True),
        "motor_speed": Gain(2.5e3, "A^2 s^2/m^2", cost=True),
        "tool": Gain(1e7, "A^2/m^2", cost=True),
        "tool_speed": Gain(10.0, "A^2 s^2/m^2", cost=True),
    }


def integrated(machine: FlexibleMachine) -> dict[str, Gain]:
    """Weight on the integral of the position error: as heavy after 20 ms as the error itself."""
    return {"integral": Gain(2.5e10, "A^2/(m s)^2", cost=True)}


def delayed(machine: FlexibleMachine) -> dict[str, Gain]:
    """A double pole at the thesis's position loop.

    The input gain is taken twice as large as that of the moving mass: a drive that is late, and
    speeds by difference, leave no more room.
    """
    return {
        "stiffness": Gain(900.0, "1/s^2"),
        "damping": Gain(60.0, "1/s"),
        "input_gain": Gain(_number(2 / _heaviness(machine)), "m/(A s^2)"),
    }


def vibration(machine: FlexibleMachine) -> dict[str, Gain]:
    """The mode that a shaper cancels: the tool on its spring."""
    p = machine.parameters
    ratio = p.damping / (2 * np.sqrt(p.stiffness * p.tool_mass))
    return {
        "mode": Gain(_link_frequency(machine), "rad/s"),
        "mode_damping": Gain(float(np.mean(ratio)), "", RATIO),
    }


def drifting(machine: FlexibleMachine) -> dict[str, Gain]:
    """How fast the load that the Kalman filter follows may change."""
    return {"drift": Gain(0.02, "A per sample")}


def cascade(machine: FlexibleMachine, gains: Gains) -> Cascade:
    """P-PI on the motors; of the gains those that it knows."""
    known = {name: gains[name] for name in CascadeGains.__dataclass_fields__ if name in gains}
    return Cascade(
        CascadeGains(**known), motors(len(machine.axes)), machine.model.dt, _current_limit(machine)
    )


def time_delay(machine: FlexibleMachine, gains: Gains) -> TimeDelayControl:
    """Time-delay control on the motors."""
    return TimeDelayControl(
        gains["stiffness"],
        gains["damping"],
        gains["input_gain"],
        motors(len(machine.axes)),
        machine.model.dt,
        _current_limit(machine),
    )


def with_notch(make: MakeController) -> MakeController:
    """Controller with a notch at its output.

    The notch is made by Tustin's rule without prewarping, as in the thesis.
    """

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        section = notch(gains["notch"], gains["depth"], gains["notch_damping"], machine.model.dt)
        return Filtered(make(machine, gains), section, machine.model.inputs)

    return build


def with_low_pass(make: MakeController) -> MakeController:
    """Controller with a low pass at its output."""

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        section = low_pass(gains["low_pass"], gains["low_pass_damping"], machine.model.dt)
        return Filtered(make(machine, gains), section, machine.model.inputs)

    return build


def with_observer(
    make: MakeController, observer: Callable[..., ExtendedStateObserver]
) -> MakeController:
    """Controller from whose output the estimate of an extended state observer is subtracted.

    b0 = k_t / M_m as in the thesis.
    """

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        p = machine.parameters
        b0 = _number(p.force_constant / p.motor_mass)
        width = {"delta": gains["delta"]} if observer is NLESO else {}
        estimator = observer(gains["bandwidth"], b0, machine.model.dt, **width)
        return DisturbanceRejection(make(machine, gains), estimator, motors(len(machine.axes)))

    return build


def with_inverse(make: MakeController) -> MakeController:
    """Controller from whose output the estimate of a disturbance observer is subtracted.

    The observer's nominal model is the whole moving mass.
    """

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        b0 = _number(1 / _heaviness(machine))
        return DisturbanceObserver(
            make(machine, gains),
            motors(len(machine.axes)),
            gains["bandwidth"],
            b0,
            machine.model.dt,
        )

    return build


def with_shaper(make: MakeController, shaper: Callable[..., Shaper]) -> MakeController:
    """Controller behind an input shaper."""

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        return Shaped(make(machine, gains), shaper(gains["mode"], gains["mode_damping"]))

    return build


def placed(target: Callable[[LinearPlant], SteadyTarget]) -> MakeController:
    """State feedback with two pairs of poles."""

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        wanted = damped_poles(
            jnp.stack([gains["rigid"], gains["link"]]),
            jnp.stack([gains["rigid_damping"], gains["link_damping"]]),
            machine.model.dt,
        )
        return StateFeedback(placed_gain(machine.model, wanted), target(machine.model))

    return build


def quadratic(target: Callable[[LinearPlant], SteadyTarget]) -> MakeController:
    """State feedback by the linear-quadratic regulator."""

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        gain = lq_gain(machine.model, _state_weight(machine, gains), jnp.eye(len(machine.axes)))
        return StateFeedback(gain, target(machine.model))

    return build


def behind_reduced_observer(make: MakeController) -> MakeController:
    """Controller fed the state: that of the tool is estimated, with the thesis's gain.

    The observer takes the ZOH model. It is stable; with Euler's model it is not.
    """

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        return ReducedObserver(make(machine, gains), machine.model, thesis_gain(len(machine.axes)))

    return build


def behind_offset_free_filter(make: MakeController) -> MakeController:
    """Controller fed the state: a Kalman filter estimates all of it, with the load.

    The load is cancelled.
    """

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        measured, noise = _measured(machine)
        gain = offset_free_gain(machine.model, measured, CONTROL_NOISE, gains["drift"], noise)
        return OffsetFreeObserver(
            controller=make(machine, gains),
            model=machine.model,
            gain=gain,
            measured=measured,
            limit=_current_limit(machine),
        )

    return build


def integral_lqg(machine: FlexibleMachine, gains: Gains) -> IntegralLQG:
    """Regulator on a Kalman filter's estimate and on an integral.

    The integral is that of the motors' position errors.
    """
    model, m = machine.model, len(machine.axes)
    (measured, noise), sensors = _measured(machine), motors(m)
    integral = jnp.diag(jnp.broadcast_to(gains["integral"], (m,)))
    K, K_i = integral_lq_gains(
        model, positions_of(sensors, measured), _state_weight(machine, gains), integral, jnp.eye(m)
    )
    seen = LinearPlant(model.A, model.B, measured, model.dt)
    L = kalman_gain(seen, CONTROL_NOISE, noise)
    return IntegralLQG(
        feedback=StateFeedback(K, moving_target(model)),
        integral_gain=K_i,
        model=model,
        filter_gain=L,
        measured=measured,
        sensors=sensors,
        limit=_current_limit(machine),
    )


def _state_weight(machine: FlexibleMachine, gains: Gains) -> Float[Array, "n n"]:
    diagonal = [
        jnp.broadcast_to(gains[name], (len(machine.axes),))
        for name in ("motor", "motor_speed", "tool", "tool_speed")
    ]
    return jnp.diag(jnp.concatenate(diagonal))


def _measured(machine: FlexibleMachine) -> tuple[Float[Array, "q n"], Float[np.ndarray, " q"]]:
    """C of the motors' positions and speeds, and the standard deviations on them.

    The motors' positions and speeds are the first states.
    """
    m = len(machine.axes)
    rounding = np.broadcast_to(machine.encoder_resolution / np.sqrt(12), m)
    deviations = np.concatenate([rounding, np.full(m, SPEED_NOISE)])
    return jnp.eye(2 * m, machine.model.states), deviations


def _link_frequency(machine: FlexibleMachine) -> float:
    """Frequency of the tool on its spring [rad/s]."""
    return float(np.sqrt(np.mean(machine.parameters.stiffness / machine.parameters.tool_mass)))


def _current_limit(machine: FlexibleMachine) -> Any:
    return np.inf if machine.limits.control is None else machine.limits.control


def _below_nyquist(machine: FlexibleMachine) -> Interval:
    return Interval(1.0, 0.99 * np.pi / machine.model.dt)


def _heaviness(machine: FlexibleMachine | None):
    """Moving mass over force constant of every axis, of the thesis's when none is given."""
    p = thesis_axis() if machine is None else machine.parameters
    return (p.motor_mass + p.tool_mass) / p.force_constant


def _number(per_axis):
    """One number for a single axis."""
    return per_axis[0] if per_axis.shape == (1,) else per_axis


def axis_design(
    make: MakeController, *gain_sets: GainSet
) -> Callable[[str, str, FlexibleMachine, Controlled], GainDesign]:
    """Maker of a design from the gains that each of its parts names."""

    def design(name: str, line: str, machine: FlexibleMachine, flags: Controlled) -> GainDesign:
        named = {key: gain for gains in gain_sets for key, gain in gains(machine).items()}
        start = {key: gain.start for key, gain in named.items()}
        space = {key: gain.parameter for key, gain in named.items()}
        return GainDesign(name, machine, start, space, 1, "outputs", make, line, named)

    return design
