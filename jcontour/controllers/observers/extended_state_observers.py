"""Extended state observers: a third state estimates a motor's disturbance, and is cancelled.

    dx = v + l1 e,   dv = b0 u + zeta + l2 e,   dzeta = l3 e                (Yuan, eq. 2.10)
    e = y - x,   u = u_inner - zeta / b0,   b0 = k_t / M_m
The disturbance zeta is everything beyond a double integrator. y is the measured position of the
motor, u the control that acts, after the subtraction. Every step first updates the estimate, then
subtracts. The observer is linear (LESO), all three poles at the bandwidth w: l = (3 w, 3 w^2, w^3).
The thesis does not say how it is sampled, so there are three forms:

    ExactLESO    zero-order hold of u and y of the previous sample; stable at any bandwidth
    EulerLESO    the same by forward Euler; unstable where w dt >= 2
    CurrentLESO  exact prediction, then correction by the newest y; all poles at exp(-w dt)
The third form is no sample late.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jcontour._arrays import check_signs, is_concrete
from jcontour.controller import (
    Axes,
    Controller,
    PerAxis,
    Wrapper,
    check_axes,
    check_period,
    numbers,
)
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class Estimate(NamedTuple):
    """Estimated state of every motor."""

    position: Axes  # [m]
    speed: Axes  # [m/s]
    disturbance: Axes  # zeta, the acceleration that the model does not explain [m/s^2]


class ExtendedStateObserver(eqx.Module):
    """An observer of the motors.

    Args:
        bandwidth: w = 1 / eta_o [rad/s], one number or one for each axis.
        input_gain: b0 [m/s^2 per unit of the control], likewise.
        dt: sample period [s].

    Raises:
        ValueError: a value is not finite and above zero.
    """

    bandwidth: PerAxis = eqx.field(converter=numbers)
    input_gain: PerAxis = eqx.field(converter=numbers)
    dt: float = eqx.field(static=True)

    @abc.abstractmethod
    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """Estimate one sample later.

        Args:
            estimate: the estimate of the sample before.
            control: the control held in between.
            before: positions measured at its begin [m].
            now: positions measured at its end [m].
        """

    def __check_init__(self):
        check_signs(self, positive=("bandwidth", "input_gain", "dt"))


class ExactLESO(ExtendedStateObserver):
    """Linear observer under zero-order hold of u and y.

    With both held the estimate tends to (y, 0, -b0 u). exp(F dt) has a closed form for the triple
    pole.
    """

    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """exp(F T) = exp(-w T) (I + N T + N^2 T^2 / 2), N = F + w I nilpotent."""
        w, T = self.bandwidth, self.dt
        limit = Estimate(before, jnp.zeros_like(before), -self.input_gain * control)
        away = jax.tree.map(jnp.subtract, estimate, limit)
        once = _nilpotent(away, w)
        twice = _nilpotent(once, w)

        def held(z, d, n, nn):
            return z + jnp.exp(-w * T) * (d + T * n + T**2 / 2 * nn)

        return jax.tree.map(held, limit, away, once, twice)


class EulerLESO(ExtendedStateObserver):
    """Linear observer by forward Euler with u and y of the previous sample.

    Raises:
        ValueError: the poles 1 - w dt are not inside the unit circle; or as every observer.
    """

    def __check_init__(self):
        if is_concrete(self.bandwidth) and np.any(np.asarray(self.bandwidth) * self.dt >= 2):
            poles = 1 - np.asarray(self.bandwidth) * self.dt
            needed = f"below {2 / self.dt:.4g} rad/s"
            raise ValueError(
                f"bandwidth: needs to be {needed}, with forward Euler all eigenvalues are {poles}"
            )

    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """Estimate + T F (estimate - limit)."""
        limit = Estimate(before, jnp.zeros_like(before), -self.input_gain * control)
        rates = _rates(jax.tree.map(jnp.subtract, estimate, limit), self.bandwidth)
        return jax.tree.map(lambda z, rate: z + self.dt * rate, estimate, rates)


class CurrentLESO(ExtendedStateObserver):
    """Linear current estimator: exact prediction, then correction by the newest position.

    It has a triple pole p = exp(-w dt).
    """

    def update(self, estimate: Estimate, control: Axes, before: Axes, now: Axes) -> Estimate:
        """Prediction, then correction by e."""
        predicted = _predicted(estimate, self.input_gain * control, self.dt)
        error, w, T = now - predicted.position, self.bandwidth, self.dt
        p = jnp.exp(-w * T)
        gains = (1 - p**3, 3 * (1 - p) ** 2 * (1 + p) / (2 * T), (1 - p) ** 3 / T**2)
        return Estimate(*(z + gain * error for z, gain in zip(predicted, gains, strict=True)))


class RejectionMemory(NamedTuple):
    """Memory of `DisturbanceRejection`."""

    estimate: Estimate
    control: Axes  # that acted one sample ago
    measured: Axes  # position one sample ago [m]
    inner: Any  # memory of the wrapped controller


class DisturbanceRejection(Wrapper):
    """Any controller less the estimated disturbance of every axis: u = u_inner - zeta / b0.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), dt=1e-3)
    >>> observer = CurrentLESO(bandwidth=100.0, input_gain=2.0, dt=1e-3)
    >>> DisturbanceRejection(cascade, observer, motors(1)).preview
    1

    Args:
        controller: the wrapped controller; control i drives axis i.
        observer: an extended state observer.
        sensors: where the motors' positions are measured.
    """

    controller: Controller
    observer: ExtendedStateObserver
    sensors: Sensors

    def initial_memory(self, reference: Reference) -> RejectionMemory:
        """Estimate one sample before the first, in the steady motion of the start, undisturbed."""
        check_period(self.observer.dt, reference)
        check_axes(self.sensors.axes, reference)
        increment = reference.start_increment
        before, none = reference.position[0] - increment, jnp.zeros_like(increment)
        estimate = Estimate(before, increment / self.observer.dt, none)
        return RejectionMemory(estimate, none, before, self.controller.initial_memory(reference))

    def step(
        self, memory: RejectionMemory, plan: Any, measurement: Any
    ) -> tuple[RejectionMemory, Axes]:
        measured = self.sensors.positions(measurement)
        estimate = self.observer.update(memory.estimate, memory.control, memory.measured, measured)
        inner, control = self.controller.step(memory.inner, plan, measurement)
        control = control - estimate.disturbance / self.observer.input_gain
        return RejectionMemory(estimate, control, measured, inner), control


def _rates(d: Estimate, w: PerAxis) -> Estimate:
    """F d, the free motion of the linear observer."""
    return Estimate(
        d.speed - 3 * w * d.position, d.disturbance - 3 * w**2 * d.position, -(w**3) * d.position
    )


def _nilpotent(d: Estimate, w: PerAxis) -> Estimate:
    return jax.tree.map(lambda rate, z: rate + w * z, _rates(d, w), d)


def _predicted(estimate: Estimate, acceleration: Axes, T: float) -> Estimate:
    total = estimate.disturbance + acceleration
    return Estimate(
        estimate.position + T * estimate.speed + T**2 / 2 * total,
        estimate.speed + T * total,
        estimate.disturbance,
    )
