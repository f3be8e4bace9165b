"""Extended state observers: whatever a motor does beyond a double integrator is estimated as a third state, and cancelled.

    dx = v + l1 phi1(e),   dv = b0 u + zeta + l2 phi2(e),   dzeta = l3 phi3(e),   e = y - x
    (Yuan, eq. 2.10) u = u_inside - zeta / b0,   b0 = k_t / M_m
y is the measured position of the motor, u the control that acts: after the subtraction. Every step
first updates the estimate, then subtracts. The linear observer (LESO) has phi_i(e) = e and all
three poles at the bandwidth w: l = (3 w, 3 w^2, w^3). The thesis does not say how it is sampled, so
there are three forms:
    ExactLESO    the equation above under zero-order hold of u and y of the previous sample; stable
    at any bandwidth EulerLESO    the same by forward Euler; unstable where w dt >= 2
    CurrentLESO  the model predicts exactly, the newest y corrects, all poles at exp(-w dt): no
    sample late
The nonlinear one (NLESO) is the third form with large errors weighed less, against peaking.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller, Wrapper, check_period
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors
from jcontour.tracing import is_concrete

Axes = Float[Array, " m"]


def _numbers(value) -> Float[Array, "*m"]:
    return jnp.asarray(value, float)


class Estimate(NamedTuple):
    """Of every motor: position [m], speed [m/s] and the acceleration zeta that the model does not explain [m/s^2]."""

    position: Axes
    speed: Axes
    disturbance: Axes


class ExtendedStateObserver(eqx.Module):
    """An observer of the motors.

    Args:
        bandwidth: w = 1 / eta_o [rad/s], one number or one for each axis.
        input_gain: b0 [m/s^2 per unit of the control], likewise.
        dt: sample period [s].

    Raises:
        ValueError: a value is not finite and above zero.
    """

    bandwidth: Float[Array, "*m"] = eqx.field(converter=_numbers)
    input_gain: Float[Array, "*m"] = eqx.field(converter=_numbers)
    dt: float = eqx.field(static=True)

    @abc.abstractmethod
    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """Estimate one sample later, from the control held in between and the positions measured at both its ends."""

    def __check_init__(self):
        for name in ("bandwidth", "input_gain", "dt"):
            value = getattr(self, name)
            if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")


class ExactLESO(ExtendedStateObserver):
    """Zero-order hold: with u and y held the estimate tends to (y, 0, -b0 u), and exp(F dt) is closed for a triple pole."""

    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """exp(F T) = exp(-w T) (I + N T + N^2 T^2 / 2), N = F + w I nilpotent."""
        w, T = self.bandwidth, self.dt
        limit = Estimate(before, jnp.zeros_like(before), -self.input_gain * control)
        away = _difference(estimate, limit)
        once = _nilpotent(away, w)
        twice = _nilpotent(once, w)
        return jax.tree.map(
            lambda z, d, n, nn: z + jnp.exp(-w * T) * (d + T * n + T**2 / 2 * nn),
            limit,
            away,
            once,
            twice,
        )


class EulerLESO(ExtendedStateObserver):
    """Forward Euler with u and y of the previous sample.

    Raises:
        ValueError: the poles 1 - w dt are not inside the unit circle; or as every observer.
    """

    def __check_init__(self):
        if is_concrete(self.bandwidth) and np.any(np.asarray(self.bandwidth) * self.dt >= 2):
            poles = 1 - np.asarray(self.bandwidth) * self.dt
            raise ValueError(
                f"bandwidth: needs to be below {2 / self.dt:.4g} rad/s, with forward Euler all eigenvalues are {poles}"
            )

    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """Estimate + T F (estimate - limit)."""
        limit = Estimate(before, jnp.zeros_like(before), -self.input_gain * control)
        return jax.tree.map(
            lambda z, rate: z + self.dt * rate,
            estimate,
            _rates(_difference(estimate, limit), self.bandwidth),
        )


class CurrentLESO(ExtendedStateObserver):
    """Current estimator: exact prediction, then correction by the newest position, with a triple pole p = exp(-w dt)."""

    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """Predict, correct."""
        predicted = _predicted(estimate, self.input_gain * control, self.dt)
        error = now - predicted.position
        return _corrected(predicted, (error, error, error), self.bandwidth, self.dt)


class NLESO(ExtendedStateObserver):
    """Nonlinear current estimator: e is replaced by Han's fal in state i, scaled to a slope of one, so that small errors see the LESO.

        phi_i(e) = e  for |e| <= delta,   sign(e) delta (|e| / delta)^a_i  beyond

    Args:
        bandwidth: that of the LESO inside `delta` [rad/s].
        input_gain: b0 [m/s^2 per unit of the control].
        dt: sample period [s].
        delta: the largest error treated linearly [m].
        exponents: a_i of the three states, from 0 to 1.

    Raises:
        ValueError: `delta` is not above zero or an exponent not from 0 to 1; or as every observer.
    """

    delta: Float[Array, "*m"] = eqx.field(converter=_numbers)
    exponents: Float[Array, "3"] = eqx.field(
        converter=_numbers, default=(1.0, 0.5, 0.25)
    )  # Han's choice for three states

    def __check_init__(self):
        if is_concrete(self.delta) and not np.all(np.asarray(self.delta) > 0):
            raise ValueError(f"delta: needs to be above zero, received {self.delta}")
        if is_concrete(self.exponents) and not np.all(
            (np.asarray(self.exponents) >= 0) & (np.asarray(self.exponents) <= 1)
        ):
            raise ValueError(f"exponents: need to be from 0 to 1, received {self.exponents}")

    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """Predict, correct by phi_i(e)."""
        predicted = _predicted(estimate, self.input_gain * control, self.dt)
        scaled = (now - predicted.position) / self.delta
        size = jnp.maximum(
            jnp.abs(scaled), 1.0
        )  # one inside delta: the power is then one, with a finite slope
        errors = [self.delta * scaled * size ** (a - 1) for a in self.exponents]
        return _corrected(predicted, errors, self.bandwidth, self.dt)


class RejectionMemory(NamedTuple):
    """Estimate, the control that acted and the position measured one sample ago, and the memory of the controller inside."""

    estimate: Estimate
    control: Axes
    measured: Axes
    inner: Any


class DisturbanceRejection(Wrapper):
    """Any controller with the estimated disturbance of every axis taken off its control: u = u_inside - zeta / b0.

    Args:
        controller: the one inside; control i drives axis i.
        observer: one of this file.
        sensors: where the motors' positions are measured.
    """

    controller: Controller
    observer: ExtendedStateObserver
    sensors: Sensors

    def initial_memory(self, reference: Reference) -> RejectionMemory:
        """The estimate of the sample before the first, moving as the reference begins, undisturbed and without control.

        Raises:
            ValueError: the reference has another sample period or number of axes.
        """
        check_period(self.observer.dt, reference)
        increment = reference.start_increment
        if increment.shape[-1] != self.sensors.axes:
            raise ValueError(
                f"sensors: the reference has {increment.shape[-1]} axes, the observer reads {self.sensors.axes}"
            )
        before, none = reference.position[0] - increment, jnp.zeros_like(increment)
        estimate = Estimate(before, increment / self.observer.dt, none)
        return RejectionMemory(estimate, none, before, self.controller.initial_memory(reference))

    def step(
        self, memory: RejectionMemory, plan: Any, measurement: Any
    ) -> tuple[RejectionMemory, Axes]:
        """Update the estimate, then subtract."""
        measured = self.sensors.positions(measurement)
        estimate = self.observer.update(memory.estimate, memory.control, memory.measured, measured)
        inner, control = self.controller.step(memory.inner, plan, measurement)
        control = control - estimate.disturbance / self.observer.input_gain
        return RejectionMemory(estimate, control, measured, inner), control


def _difference(a: Estimate, b: Estimate) -> Estimate:
    return jax.tree.map(jnp.subtract, a, b)


def _rates(d: Estimate, w: Float[Array, "*m"]) -> Estimate:
    """F d, the linear observer's own motion."""
    return Estimate(
        d.speed - 3 * w * d.position, d.disturbance - 3 * w**2 * d.position, -(w**3) * d.position
    )


def _nilpotent(d: Estimate, w: Float[Array, "*m"]) -> Estimate:
    return jax.tree.map(lambda rate, own: rate + w * own, _rates(d, w), d)


def _predicted(estimate: Estimate, acceleration: Axes, T: float) -> Estimate:
    total = estimate.disturbance + acceleration
    return Estimate(
        estimate.position + T * estimate.speed + T**2 / 2 * total,
        estimate.speed + T * total,
        estimate.disturbance,
    )


def _corrected(predicted: Estimate, errors, w: Float[Array, "*m"], T: float) -> Estimate:
    p = jnp.exp(-w * T)
    gains = (1 - p**3, 3 * (1 - p) ** 2 * (1 + p) / (2 * T), (1 - p) ** 3 / T**2)
    return Estimate(
        *(state + gain * error for state, gain, error in zip(predicted, gains, errors, strict=True))
    )
