"""Controllers of flexible axes, built from gains.

They are the cascade with its parts around it, and state feedback behind its observers.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.designs.design import Design, Gains, Needs, picked
from jcontour.app.machines.flexible_axis import FlexibleMachine
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.pole_placement import damped_poles, placed_gain
from jcontour.controllers.feedback.state_feedback import (
    IntegralLQG,
    StateFeedback,
    SteadyTarget,
    integral_lq_gains,
    lq_gain,
    moving_target,
    positions_of,
    quasi_steady_target,
)
from jcontour.controllers.observers.disturbance_observer import (
    DisturbanceObserver,
    ReducedObserver,
    TimeDelayControl,
    thesis_gain,
)
from jcontour.controllers.observers.extended_state_observers import (
    CurrentLESO,
    DisturbanceRejection,
    EulerLESO,
    ExactLESO,
    ExtendedStateObserver,
)
from jcontour.controllers.observers.kalman import OffsetFreeObserver, kalman_gain, offset_free_gain
from jcontour.controllers.wrappers.filters import Filtered, Shaped, low_pass, notch
from jcontour.linear.plant import LinearPlant
from jcontour.motion.input_shaping import Shaper, ei, zv, zvd
from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.sensors import motors
from tuning.parameters import Interval, Weight

# of damping: poles stay complex, and Ackermann's formula well conditioned
RATIO = Interval(0.02, 0.98)
SPEED_NOISE = 1e-3  # [m/s] of the drive's speed, as the Kalman filter takes it
CONTROL_NOISE = 0.1  # [A] of what the model does not know, as it changes from sample to sample


class AxisDesign(Design[FlexibleMachine]):
    """A controller of flexible axes; it sees a sample ahead."""

    needs = Needs("a flexible axis", "flexible axes")

    def first_preview(self, first: Gains) -> int:
        return 1


class AxisCascade(AxisDesign):
    """P position loop around a PI velocity loop.

    Gains are those of the thesis, section 3.4.2.
    """

    weights = (
        Weight("position", "1/s", start=30.0),
        # as fast as that of the thesis's axis
        Weight("velocity", "A s/m", start=lambda m: _number(55.67 * _inertia(m) / _inertia(None))),
        Weight("integral_time", "s", start=0.04),
    )

    def build(self, weights: Gains) -> Controller:
        return self.cascade(weights)

    def cascade(self, gains: Gains) -> Cascade:
        """P-PI on the motors; of the gains those that it knows."""
        known = {name: gains[name] for name in CascadeGains.__dataclass_fields__ if name in gains}
        axes, dt = len(self.machine.axes), self.machine.model.dt
        return Cascade(CascadeGains(**known), motors(axes), dt, current_limit(self.machine))


def _viscous(machine: FlexibleMachine):
    p = machine.parameters
    return _number(p.friction.viscous / p.force_constant)


def _dry(machine: FlexibleMachine):
    """Current that the guide ways take at rest."""
    p = machine.parameters
    return _number((p.friction.coulomb + p.friction.stribeck) / p.force_constant)


DRY_FRICTION = Weight("coulomb", "A", start=_dry)


class AxisFeedforward(AxisCascade):
    """P-PI cascade fed what the motion needs: speed, inertia, viscous and dry friction.

    Feedforward gains are those of the model.
    """

    weights = (
        *AxisCascade.weights,
        Weight("feedforward", start=1.0),
        Weight("inertia", "A s^2/m", start=lambda machine: _number(_inertia(machine))),
        Weight("viscous", "A s/m", start=_viscous),
        DRY_FRICTION,
    )


def _below_nyquist(machine: FlexibleMachine) -> Interval:
    return Interval(1.0, 0.99 * np.pi / machine.model.dt)


class AxisNotch(AxisCascade):
    """P-PI cascade through a notch.

    It is the thesis's, section 3.4.2, made by Tustin's rule without prewarping.
    """

    weights = (
        *AxisCascade.weights,
        Weight("notch", "rad/s", _below_nyquist, 87.0),
        Weight("depth", start=0.85),
        Weight("notch_damping", start=0.05),
    )

    def build(self, weights: Gains) -> Controller:
        model = self.machine.model
        section = notch(*picked("notch depth notch_damping", weights), model.dt)
        return Filtered(super().build(weights), section, model.inputs)


class AxisLowPass(AxisCascade):
    """P-PI cascade through a low pass, a decade above the velocity loop."""

    weights = (
        *AxisCascade.weights,
        Weight("low_pass", "rad/s", _below_nyquist, 1000.0),
        Weight("low_pass_damping", start=np.sqrt(0.5)),
    )

    def build(self, weights: Gains) -> Controller:
        model = self.machine.model
        section = low_pass(*picked("low_pass low_pass_damping", weights), model.dt)
        return Filtered(super().build(weights), section, model.inputs)


class AxisRejection(AxisCascade):
    """P-PI cascade with a linear extended state observer.

    It is the thesis's, section 3.4.2, with b0 = k_t / M_m. Forward Euler is stable up to 2 / dt.
    """

    weights = (
        *AxisCascade.weights,
        Weight("bandwidth", "rad/s", lambda axis: Interval(1.0, 1.9 / axis.model.dt), 700.0),
    )
    observer: ClassVar[type[ExtendedStateObserver]] = CurrentLESO

    def build(self, weights: Gains) -> Controller:
        p, machine = self.machine.parameters, self.machine
        b0 = _number(p.force_constant / p.motor_mass)
        estimator = self.observer(weights["bandwidth"], b0, machine.model.dt)
        return DisturbanceRejection(super().build(weights), estimator, motors(len(machine.axes)))


class AxisExactRejection(AxisRejection):
    """The same, its observer one sample late under zero-order hold."""

    observer = ExactLESO


class AxisEulerRejection(AxisRejection):
    """The same by forward Euler."""

    observer = EulerLESO


class AxisDisturbanceObserver(AxisCascade):
    """P-PI cascade with a disturbance observer.

    Its nominal model is the whole moving mass; it is somewhat faster than the velocity loop.
    """

    weights = (
        *AxisCascade.weights,
        Weight("bandwidth", "rad/s", lambda axis: Interval(1.0, 1.0 / axis.model.dt), 100.0),
    )

    def build(self, weights: Gains) -> Controller:
        b0, sensors = _number(1 / _inertia(self.machine)), motors(len(self.machine.axes))
        dt, loops = self.machine.model.dt, super().build(weights)
        return DisturbanceObserver(loops, sensors, weights["bandwidth"], b0, dt)


def _link_frequency(machine: FlexibleMachine) -> float:
    """Frequency of the tool on its spring [rad/s]."""
    return float(np.sqrt(np.mean(machine.parameters.stiffness / machine.parameters.tool_mass)))


def _link_damping(machine: FlexibleMachine) -> float:
    p = machine.parameters
    return float(np.mean(p.damping / (2 * np.sqrt(p.stiffness * p.tool_mass))))


class AxisShaped(AxisFeedforward):
    """P-PI cascade with feedforward behind a zero-vibration shaper.

    The shaper cancels the mode of the tool on its spring.
    """

    weights = (
        *AxisFeedforward.weights,
        Weight("mode", "rad/s", start=_link_frequency),
        Weight("mode_damping", range=RATIO, start=_link_damping),
    )
    shaper: ClassVar[Callable[..., Shaper]] = staticmethod(zv)

    def build(self, weights: Gains) -> Controller:
        return Shaped(super().build(weights), self.shaper(*picked("mode mode_damping", weights)))


class AxisFlatShaped(AxisShaped):
    """The same behind a zero-vibration-and-derivative shaper."""

    shaper = staticmethod(zvd)


class AxisInsensitiveShaped(AxisShaped):
    """The same behind an extra-insensitive shaper."""

    shaper = staticmethod(ei)


class AxisTimeDelay(AxisDesign):
    """Time-delay control: what acted a sample ago stands for the disturbance of now.

    It has a double pole at the thesis's position loop. The input gain is twice that of the moving
    mass: a drive that is late, and speeds by difference, leave no more room.
    """

    weights = (
        Weight("stiffness", "1/s^2", start=900.0),
        Weight("damping", "1/s", start=60.0),
        Weight("input_gain", "m/(A s^2)", start=lambda axis: _number(2 / _inertia(axis))),
    )

    def build(self, weights: Gains) -> Controller:
        sensors, dt = motors(len(self.machine.axes)), self.machine.model.dt
        limit = current_limit(self.machine)
        return TimeDelayControl(**weights, sensors=sensors, dt=dt, limit=limit)


class AxisPoles(AxisDesign):
    """State feedback by its poles, moving target, reduced observer.

    A rigid pair is as fast as the thesis's velocity loop; the link keeps its own, damped.
    """

    weights = (
        Weight("rigid", "rad/s", start=60.0),
        Weight("rigid_damping", range=RATIO, start=0.9),
        Weight("link", "rad/s", start=_link_frequency),
        Weight("link_damping", range=RATIO, start=0.1),
    )

    def build(self, weights: Gains) -> Controller:
        model = self.machine.model
        places, ratios = (
            picked("rigid link", weights),
            picked("rigid_damping link_damping", weights),
        )
        wanted = damped_poles(jnp.stack(places), jnp.stack(ratios), model.dt)
        feedback = StateFeedback(placed_gain(model, wanted), moving_target(model))
        return _observed(self.machine, feedback)


class AxisLQ(AxisDesign):
    """Linear-quadratic state feedback, moving target, reduced observer.

    Its weights are the diagonal of Q beside R = 1 / A^2: an ampere weighs as much as 0.3 mm of the
    motor or the tool, or as 20 mm/s of the motor.
    """

    weights = (
        Weight("motor", "A^2/m^2", start=1e7, cost=True),
        Weight("motor_speed", "A^2 s^2/m^2", start=2.5e3, cost=True),
        Weight("tool", "A^2/m^2", start=1e7, cost=True),
        Weight("tool_speed", "A^2 s^2/m^2", start=10.0, cost=True),
    )
    target: ClassVar[Callable[[LinearPlant], SteadyTarget]] = moving_target

    def build(self, weights: Gains) -> Controller:
        return _observed(self.machine, self.regulator(weights))

    def state_cost(self, model: LinearPlant, weights: Gains) -> Float[Array, "n n"]:
        """Diagonal weight Q on the positions and speeds of motors and tools."""
        names = ("motor", "motor_speed", "tool", "tool_speed")
        axes = len(self.machine.axes)
        diagonal = [jnp.broadcast_to(weights[name], (axes,)) for name in names]
        return jnp.diag(jnp.concatenate(diagonal))

    def regulator(self, weights: Gains) -> StateFeedback:
        """State feedback by the linear-quadratic regulator."""
        model, m = self.machine.model, len(self.machine.axes)
        gain = lq_gain(model, self.state_cost(model, weights), jnp.eye(m))
        return StateFeedback(gain, type(self).target(model))


class AxisQuasiSteadyLQ(AxisLQ):
    """The same with the thesis's target, at rest wherever the reference is."""

    target = quasi_steady_target


class AxisOffsetFreeLQG(AxisLQ):
    """Linear-quadratic state feedback, Kalman filter that finds the load and cancels it."""

    weights = (*AxisLQ.weights, Weight("drift", "A per sample", start=0.02))

    def build(self, weights: Gains) -> Controller:
        model, (measured, noise) = self.machine.model, _measured(self.machine)
        return OffsetFreeObserver(
            controller=self.regulator(weights),
            model=model,
            gain=offset_free_gain(model, measured, CONTROL_NOISE, weights["drift"], noise),
            measured=measured,
            limit=current_limit(self.machine),
        )


class AxisLQG(AxisLQ):
    """Linear-quadratic state feedback, Kalman filter, integral action.

    The integral is that of the motors' errors, as heavy after 20 ms as the error itself.
    """

    weights = (*AxisLQ.weights, Weight("integral", "A^2/(m s)^2", start=2.5e10, cost=True))

    def build(self, weights: Gains) -> Controller:
        model, m = self.machine.model, len(self.machine.axes)
        (measured, noise), sensors = _measured(self.machine), motors(m)
        K, K_i = integral_lq_gains(
            model,
            positions_of(sensors, measured),
            self.state_cost(model, weights),
            jnp.diag(jnp.broadcast_to(weights["integral"], (m,))),
            jnp.eye(m),
        )
        seen = LinearPlant(model.A, model.B, measured, model.dt)
        return IntegralLQG(
            feedback=StateFeedback(K, moving_target(model)),
            integral_gain=K_i,
            model=model,
            filter_gain=kalman_gain(seen, CONTROL_NOISE, noise),
            measured=measured,
            sensors=sensors,
            limit=current_limit(self.machine),
        )


def _observed(machine: FlexibleMachine, feedback: StateFeedback) -> ReducedObserver:
    """State feedback whose tool is estimated: the observer takes the ZOH model.

    It is stable; with Euler's model it is not.
    """
    return ReducedObserver(feedback, machine.model, thesis_gain(len(machine.axes)))


def _measured(machine: FlexibleMachine) -> tuple[Float[Array, "q n"], Float[np.ndarray, " q"]]:
    """C of the motors' positions and speeds, and the standard deviations on them.

    The motors' positions and speeds are the first states.
    """
    m = len(machine.axes)
    rounding = np.broadcast_to(machine.encoder_resolution / np.sqrt(12), m)
    deviations = np.concatenate([rounding, np.full(m, SPEED_NOISE)])
    return jnp.eye(2 * m, machine.model.states), deviations


def current_limit(machine: FlexibleMachine) -> Any:
    """Limit of the drives' currents; infinite where none is stated."""
    return np.inf if machine.limits.control is None else machine.limits.control


def _inertia(machine: FlexibleMachine | None):
    """Moving mass over force constant of every axis, of the thesis's when none is given."""
    p = thesis_axis() if machine is None else machine.parameters
    return (p.motor_mass + p.tool_mass) / p.force_constant


def _number(per_axis):
    """One number for a single axis."""
    return per_axis[0] if per_axis.shape == (1,) else per_axis
