"""LQG with integral action on the measured position error.

    u = u_d - K (xf - x_d) - K_i w,     w(k+1) = w(k) + T (y_i - C_i x_d)
y_i are the measured positions to be reached, C_i their rows of the model, and xf is the filtered
estimate of `kalman`. K and K_i are the LQ gain of the model with its integrals,

    [x; w](k+1) = [A, 0; T C_i, I] [x; w] + [B; 0] u.
The measurement is integrated, not the estimate: a load or a wrong input gain biases the estimate,
and its integral would settle at the biased value. Without the integral both leave an error at rest
and in steady motion; with it they leave none. The integral is kept as its share K_i w of the
control. While a control is at its limit, its share holds still as long as it would drive the
control further out. The filter is told the control that acts. So neither of them winds up.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, check_limit, check_period
from jcontour.controllers.feedback.state_feedback import StateFeedback, lq_gain
from jcontour.controllers.observers.kalman import check_gain
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors, row


class IntegralPlan(eqx.Module):
    """Targets of every step."""

    state: Float[Array, "T n"]  # x_d
    control: Float[Array, "T p"]  # u_d
    position: Float[Array, "T m"]  # C_i x_d [m]


class IntegralMemory(NamedTuple):
    """The predicted state, and the integral's share of the control."""

    estimate: Float[Array, " n"]
    share: Float[Array, " p"]


class IntegralLQG(Controller):
    """LQG with integral action, for any number of axes.

    Args:
        feedback: K and the target.
        integral_gain: K_i (p, m), control per m s.
        model: model of the machine; its output is the tool.
        filter_gain: L (n, q) of the Kalman filter.
        measured: C (q, n) of the measurement.
        sensors: where the positions to be reached stand in it, one for each axis.
        limit: limit of the control, +-: one number or one for each; none when infinite.

    Raises:
        ValueError: a gain has the wrong shape, the filter or the loop is not stable on the model,
            or a limit is not above zero.
    """

    feedback: StateFeedback
    integral_gain: Float[Array, "p m"] = eqx.field(converter=jnp.asarray)
    model: LinearPlant
    filter_gain: Float[Array, "n q"] = eqx.field(converter=jnp.asarray)
    measured: Float[Array, "q n"] = eqx.field(converter=jnp.asarray)
    sensors: Sensors
    limit: Float[Array, ""] | Float[Array, " p"] = eqx.field(converter=jnp.asarray, default=np.inf)

    def __check_init__(self):
        check_gain(self.model.A, self.measured, self.filter_gain, "filter_gain")
        wanted = (self.model.inputs, self.sensors.axes)
        if self.integral_gain.shape != wanted:
            raise ValueError(
                f"integral_gain: needs shape {wanted}, received {self.integral_gain.shape}"
            )
        check_limit(self.limit)
        whole = with_integrals(self.model, positions_of(self.sensors, self.measured))
        gain = jnp.concatenate([self.feedback.gain, self.integral_gain], axis=1)
        check_stable("integral_gain: the loop", whole.A - whole.B @ gain)

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Samples of the future that the state feedback needs."""
        return self.feedback.preview

    def prepare(self, reference: Reference) -> IntegralPlan:
        """Targets of every step."""
        plan = self.feedback.prepare(reference)
        position = plan.state @ positions_of(self.sensors, self.measured).T
        return IntegralPlan(plan.state, plan.control, position)

    def initial_memory(self, reference: Reference) -> IntegralMemory:
        """The estimate starts where the reference says the run begins, the integral at zero.

        Raises:
            ValueError: the reference has another sample period.
        """
        check_period(self.model.dt, reference)
        start = self.model.initial_state(reference.position[0], reference.start_increment)
        return IntegralMemory(start, jnp.zeros(self.model.inputs, start.dtype))

    def step(
        self, memory: IntegralMemory, plan: IntegralPlan, measurement: Any
    ) -> tuple[IntegralMemory, Float[Array, " p"]]:
        """Correction, control, integration, prediction."""
        innovation = row(measurement) - self.measured @ memory.estimate
        filtered = memory.estimate + self.filter_gain @ innovation
        wanted = plan.control - self.feedback.gain @ (filtered - plan.state) - memory.share
        control = jnp.clip(wanted, -self.limit, self.limit)
        error = self.sensors.positions(measurement) - plan.position
        change = self.model.dt * self.integral_gain @ error
        further_out = (wanted - control) * change < 0  # the share is subtracted
        share = memory.share + jnp.where(further_out, 0.0, change)
        return IntegralMemory(self.model.step(filtered, control), share), control


def with_integrals(model: LinearPlant, positions: Float[Array, "m n"]) -> LinearPlant:
    """Model with the integrals of these positions [m s]: state [x, w], the same output."""
    n, m = model.states, positions.shape[0]
    A = jnp.block([[model.A, jnp.zeros((n, m))], [model.dt * positions, jnp.eye(m)]])
    B = jnp.concatenate([model.B, jnp.zeros((m, model.inputs))])
    C = jnp.concatenate([model.C, jnp.zeros((model.axes, m))], axis=1)
    return LinearPlant(A, B, C, model.dt)


def integral_lq_gains(
    model: LinearPlant,
    positions: Float[Array, "m n"],
    state_weight: Float[ArrayLike, "n n"],
    integral_weight: Float[ArrayLike, "m m"],
    control_weight: Float[ArrayLike, "p p"],
) -> tuple[Float[Array, "p n"], Float[Array, "p m"]]:
    """Gains K and K_i that minimise the sum of x'Q x + w'Q_i w + u'R u.

    Raises:
        ValueError: no stabilising solution of the Riccati equation.
    """
    Q, Q_i = jnp.asarray(state_weight, float), jnp.asarray(integral_weight, float)
    both = jax.scipy.linalg.block_diag(Q, Q_i)
    gain = lq_gain(with_integrals(model, positions), both, control_weight)
    return gain[:, : model.states], gain[:, model.states :]


def positions_of(sensors: Sensors, measured: Float[ArrayLike, "q n"]) -> Float[Array, "m n"]:
    """Matrix C_i from the state to the positions in the measurement."""
    return jax.vmap(sensors.positions, in_axes=1, out_axes=1)(jnp.asarray(measured, float))
