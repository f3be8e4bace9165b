"""Adaptive zero phase error tracking (Tsao & Tomizuka; Smith & Lee, (19)-(21)).

    y(k+1) = -a_1 y(k) + b_0 r(k),    r(k) = (y_d(k+1) + a_1 y_d(k)) / b_0         (21)
    u(k) = k_p (r(k) - y(k)) + u_0

The closed position loop is modelled by one pole. a_1 and b_0 are estimated while the machine
moves. (21) prints r on its right side, for y_d. Positions count from the start of the run,
where u_0 holds a drive that takes a position.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._tracing import is_concrete
from jcontour.controller import Controller, check_axes, check_period, checked_period
from jcontour.controllers.feedforward.normalised_least_squares import (
    Estimate,
    NormalisedLeastSquares,
)
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class AdaptiveMemory(NamedTuple):
    """Estimates of every axis, and the regressor of the last sample."""

    estimate: Estimate
    phi: Float[Array, "m 2"]  # (-y, r) [m]


class _Plan(NamedTuple):
    """Desired positions now and next, and where the run starts [m]."""

    now: Float[Array, "*T m"]
    later: Float[Array, "*T m"]
    start: Float[Array, "*T m"]


class AdaptiveZeroPhaseTracking(Controller):
    """A position loop whose filter adapts to the loop, each axis for itself.

    Args:
        gain: k_p, control per m.
        theta: first a_1 and b_0, (2,) for all axes or (m, 2).
        estimator: least squares; `trace` 2 f_0 of the paper, `floor` 1e-3 m: it divides lengths in
            mm by at least one.
        sensors: where the positions stand in the measurement.
        dt: sample period [s].
        smallest: least b_0 that an estimate may have: the model stays invertible.
        holding: control per m that holds an axis at rest, as in `Cascade`.

    Raises:
        ValueError: the gain, `smallest` or `dt` is not above zero, or b_0 begins below `smallest`.
    """

    laws_not_kept = {"restart": "positions are those from the point at which a run begins"}
    gain: Float[Array, "*m"]
    theta: Float[Array, "*m 2"]
    estimator: NormalisedLeastSquares
    sensors: Sensors
    smallest: Float[Array, ""]
    holding: Float[Array, "*m"]
    dt: float = eqx.field(static=True)
    preview: int = eqx.field(static=True, default=1)

    def __init__(
        self,
        gain: ArrayLike,
        theta,
        estimator: NormalisedLeastSquares,
        sensors: Sensors,
        dt: float,
        smallest: ArrayLike = 0.02,  # a closed loop of 1 rad/s at 20 ms has b_0 = 0.02
        holding: ArrayLike = 0.0,
    ):
        self.gain, self.theta, self.smallest, self.holding = (
            jnp.asarray(x, float) for x in (gain, theta, smallest, holding)
        )
        for name, value in (("gain", gain), ("smallest", smallest)):
            if is_concrete(value) and not np.all(np.asarray(value) > 0):
                raise ValueError(f"{name}: needs to be above zero, received {value}")
        if is_concrete(self.theta, self.smallest) and not np.all(
            np.asarray(self.theta)[..., 1] >= np.asarray(self.smallest)
        ):
            raise ValueError(f"theta: b_0 needs to be at least {smallest}, received {theta}")
        self.estimator, self.sensors, self.dt = estimator, sensors, checked_period(dt)
        self.preview = 1

    def prepare(self, reference: Reference) -> _Plan:
        """Desired positions from the start of the run.

        Raises:
            ValueError: the reference has another sample period or number of axes.
        """
        check_axes(self.sensors.axes, reference)
        check_period(self.dt, reference)
        steps, start = reference.steps, reference.position[:1]
        away = reference.position - start
        return _Plan(away[:steps], away[1 : steps + 1], jnp.broadcast_to(start, away[:steps].shape))

    def initial_memory(self, reference: Reference) -> AdaptiveMemory:
        """First estimates; the empty regressor teaches nothing."""
        axes = reference.position.shape[1]
        theta = jnp.broadcast_to(self.theta, (axes, 2))
        return AdaptiveMemory(self.estimator.start(theta), jnp.zeros_like(theta))

    def step(
        self, memory: AdaptiveMemory, plan: _Plan, measurement
    ) -> tuple[AdaptiveMemory, Float[Array, " m"]]:
        """Learn from the last sample, then invert the model."""
        position = self.sensors.positions(measurement) - plan.start
        estimate = self.estimator.update(memory.estimate, memory.phi, position)
        estimate = estimate._replace(theta=self._invertible(estimate.theta))
        a, b = estimate.theta[:, 0], estimate.theta[:, 1]
        filtered = (plan.later + a * plan.now) / b
        phi = jnp.stack([-position, filtered], axis=-1)
        control = self.gain * (filtered - position) + self.holding * plan.start
        return AdaptiveMemory(estimate, phi), control

    def _invertible(self, theta: Float[Array, "m 2"]) -> Float[Array, "m 2"]:
        """Nearest parameters whose b_0 is large enough."""
        return theta.at[:, 1].set(jnp.maximum(theta[:, 1], self.smallest))
