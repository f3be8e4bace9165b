"""Axes that move together: adaptive feedforward, with the difference of two axes fed back.

Tomizuka, Hu, Chiu & Kamano (1990), eqs. 11 and 14-16. Axis i has the speed error
e_i = w_i - v_i, two of the axes are a pair, and beta couples them:

    e*_i = e_i + beta (e_i - e_j)      within the pair,   e*_i = e_i elsewhere
    theta_i(k) = theta_i(k-1) + gamma phi_i(k-1) e*_i(k)
    phi_i(k) = (v_r(k), v_r(k+1), v_c),   u_i = k_c e*_i + theta_i . phi_i
with v_r the speed of the reference, and no change of theta before the first step. In the paper the
speed commanded is w = v_r. Its extension to positions, which it calls straightforward, is here
w = v_r + k_p (r - y); k_p = 0 is the paper. Its proof takes phi_1 = phi_2: axes that share one
reference. beta has a bound: see `speed_axes`.

Under master-slave synchronisation the slave follows where the master is:

    r_s* = r_s + beta (y_m - r_m),   v_s* = v_s + beta (v_m - dr_m/dt)
With beta = 1 and one reference for both this is the electronic gearbox, r_s* = y_m: the master's
errors are the slave's, those of the slave are its own. beta = 0 leaves the axes to themselves.
Tomizuka et al. (1990) compare their coupling with it: there both axes see each other's errors.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import check_signs
from jcontour.controller import (
    Controller,
    PerAxis,
    check_axes,
    check_period,
    checked_period,
    numbers,
)
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.controllers.wrappers.adapters import WithoutLearning
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class SynchronisedGains(eqx.Module):
    """Gains of the law: traceable.

    Args:
        proportional: k_c, control per unit of speed error.
        adaptation: gamma; zero leaves the feedforward as it is.
        coupling: beta; zero leaves the axes to themselves.
        position: k_p [1/s]; zero follows speeds alone, as the paper does.
        bias: v_c, the constant that the load is estimated by.

    Raises:
        ValueError: a gain is not finite or negative, or the bias is not above zero.
    """

    proportional: PerAxis = eqx.field(converter=numbers)
    adaptation: PerAxis = eqx.field(converter=numbers)
    coupling: Float[Array, ""] = eqx.field(converter=numbers)
    position: PerAxis = eqx.field(converter=numbers, default=0.0)
    bias: Float[Array, ""] = eqx.field(converter=numbers, default=1.0)

    def __check_init__(self):
        others = "proportional", "adaptation", "coupling", "position"
        check_signs(self, positive=("bias",), not_negative=others)


class SynchronisedPlan(eqx.Module):
    """Reference of every axis; T samples as `prepare` makes it, one row in a step."""

    position: Float[Array, "*T m"]  # [m]
    speed: Float[Array, "*T m"]  # v_r(k), from this sample to the next [m/s]
    later: Float[Array, "*T m"]  # v_r(k+1) [m/s]


class Adaptation(NamedTuple):
    """Memory: the estimates, and the signals that they were multiplied by one sample ago."""

    estimate: Float[Array, "m 3"]
    signals: Float[Array, "m 3"]


class AdaptiveSynchronisation(Controller):
    """Adaptive feedforward for every axis, and two axes that share their errors.

    A step of an axis that stands: the estimates do not change, the feedback acts.

    >>> from jcontour.sensors import motors
    >>> gains = SynchronisedGains(proportional=0.3, adaptation=0.022, coupling=2.0)
    >>> controller = AdaptiveSynchronisation(gains, motors(2), dt=2e-3)
    >>> rest = Adaptation(controller.start, jnp.zeros((2, 3)))
    >>> plan = SynchronisedPlan(jnp.zeros(2), jnp.ones(2), jnp.ones(2))
    >>> _, control = controller.step(rest, plan, (jnp.zeros(2), jnp.array([1.0, 0.9])))
    >>> control.round(6).tolist()
    [-0.06, 0.09]

    Args:
        gains: of the law.
        sensors: where the positions and speeds stand in the measurement.
        dt: sample period [s].
        start: first estimates (m, 3), see `SpeedAxes.feedforward`; zero when not given.
        pair: the two axes that move together.

    Raises:
        ValueError: `dt` is not above zero, the sensors give no speeds, the estimates have another
            shape, or the pair is not two different axes.
    """

    gains: SynchronisedGains
    sensors: Sensors
    start: Float[Array, "m 3"]
    dt: float = eqx.field(static=True)
    pair: tuple[int, int] = eqx.field(static=True)
    preview: int = eqx.field(static=True, default=2)  # v_r(k+1) needs r(k+2)

    def __init__(
        self,
        gains: SynchronisedGains,
        sensors: Sensors,
        dt: float,
        start: ArrayLike | None = None,
        pair: tuple[int, int] = (0, 1),
    ):
        if not sensors.velocity:
            raise ValueError("sensors: speeds are synchronised, received positions only")
        axes = sensors.axes
        if len(set(pair)) != 2 or not all(0 <= axis < axes for axis in pair):
            raise ValueError(f"pair: needs two of the {axes} axes, received {pair}")
        start = jnp.zeros((axes, 3)) if start is None else jnp.asarray(start, float)
        if start.shape != (axes, 3):
            raise ValueError(f"start: needs the shape ({axes}, 3), received {start.shape}")
        self.gains, self.sensors, self.start = gains, sensors, start
        self.dt, self.pair, self.preview = checked_period(dt), pair, 2

    def prepare(self, reference: Reference) -> SynchronisedPlan:
        check_axes(self.sensors.axes, reference)
        check_period(self.dt, reference)
        steps = reference.steps
        speed = jnp.diff(reference.position[: steps + 2], axis=0) / self.dt
        return SynchronisedPlan(reference.position[:steps], speed[:-1], speed[1:])

    def initial_memory(self, reference: Reference) -> Adaptation:
        return Adaptation(self.start, jnp.zeros_like(self.start))

    def without_planned_limits(self) -> WithoutLearning:
        return WithoutLearning(self)

    def step(
        self, memory: Adaptation, plan: SynchronisedPlan, measurement
    ) -> tuple[Adaptation, Float[Array, " m"]]:
        gains = self.gains
        position, speed = self.sensors.read(measurement)
        command = plan.speed + gains.position * (plan.position - position)
        error = coupled_errors(command - speed, gains.coupling, self.pair)
        estimate = memory.estimate + memory.signals * (gains.adaptation * error)[:, None]
        bias = jnp.broadcast_to(gains.bias, speed.shape)
        signals = jnp.stack([plan.speed, plan.later, bias], axis=-1)
        control = gains.proportional * error + jnp.sum(estimate * signals, axis=-1)
        return Adaptation(estimate, signals), control


def coupled_errors(
    error: Float[Array, " m"], coupling: ArrayLike, pair: tuple[int, int] = (0, 1)
) -> Float[Array, " m"]:
    """Errors e* of the axes, those of the pair pulled together.

    e* = C e,   C = [[1 + beta, -beta], [-beta, 1 + beta]]  within the pair
    """
    one, other = pair
    apart = coupling * (error[one] - error[other])
    return error.at[one].add(apart).at[other].add(-apart)


class MasterSlave(Controller):
    """A cascade in which one axis follows another.

    Args:
        cascade: the axes.
        pair: the master and the slave.
        coupling: beta, the part of the master's error that the slave takes over.

    Raises:
        ValueError: the pair is not two different axes, or the coupling is negative or not finite.
    """

    cascade: Cascade
    pair: tuple[int, int] = eqx.field(static=True, default=(0, 1))
    coupling: Float[Array, ""] = eqx.field(converter=numbers, default=1.0)
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        axes, pair = self.cascade.sensors.axes, self.pair
        if len(set(pair)) != 2 or not all(0 <= axis < axes for axis in pair):
            raise ValueError(f"pair: needs two of the {axes} axes, received {pair}")
        check_signs(self, not_negative=("coupling",))

    def prepare(self, reference: Reference) -> CascadePlan:
        return self.cascade.prepare(reference)

    def initial_memory(self, reference: Reference) -> Float[Array, " m"]:
        return self.cascade.initial_memory(reference)

    def step(
        self, memory: Float[Array, " m"], plan: CascadePlan, measurement
    ) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        (master, slave), cascade = self.pair, self.cascade
        position, velocity = cascade.sensors.read(measurement)
        off = position[master] - plan.position[master]
        faster = velocity[master] - plan.velocity[master]
        command = CascadePlan(
            plan.position.at[slave].add(self.coupling * off),
            plan.velocity.at[slave].add(self.coupling * faster),
            plan.control,
        )
        speed = cascade.speed_command(command, position)
        return cascade.drive(memory, speed - velocity, plan.control)
