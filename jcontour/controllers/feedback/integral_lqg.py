"""LQG with integral action: state feedback on a Kalman filter's estimate and on the integral of the measured position error.

    u = u_d - K (xf - x_d) - K_i w,     w(k+1) = w(k) + T (y_i - C_i x_d)
y_i, measured, are the positions that have to be reached, C_i their rows of the model, and xf is the
filtered estimate of `observers`. K and K_i are the LQ gain of the model with its integrals,
    [x; w](k+1) = [A, 0; T C_i, I] [x; w] + [B; 0] u.
The integral is taken of the measurement: that of an estimate would settle where the estimate is
right, and a load or a wrong input gain biases it. Both leave an error at rest and in steady motion
without the integral, and none with it. The integral is kept as its share K_i w of the control.
Where a control is at its limit, its share holds still as long as it would drive the
control further out, and the filter is told the control that acts: neither of them winds up.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller, check_limit, check_period
from jcontour.controllers.feedback.state_feedback import StateFeedback, lq_gain
from jcontour.controllers.observers.kalman import check_gain
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors, row


class IntegralPlan(eqx.Module):
    """x_d, u_d and the positions C_i x_d of every step."""

    state: Float[Array, "T n"]
    control: Float[Array, "T p"]
    position: Float[Array, "T m"]


class IntegralMemory(NamedTuple):
    """The predicted state, and the integral's share of the control."""

    estimate: Float[Array, " n"]
    share: Float[Array, " p"]


class IntegralLQG(Controller):
    """LQG with integral action, for any number of axes.

    Args:
        feedback: K and the target.
        integral_gain: K_i (p, m), control per m s.
        model: of the machine; its output is the tool.
        filter_gain: L (n, q) of the Kalman filter.
        measured: C (q, n) of what the sensors show.
        sensors: which of it are the positions to be reached, one for each axis.
        limit: of the control, +-: one number or one for each; none when infinite.

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
    limit: Float[Array, "*p"] = eqx.field(converter=jnp.asarray, default=np.inf)

    def __check_init__(self):
        check_gain(self.model.A, self.measured, self.filter_gain, "filter_gain")
        wanted = (self.model.inputs, self.sensors.axes)
        if self.integral_gain.shape != wanted:
            raise ValueError(
                f"integral_gain: needs shape {wanted}, received {self.integral_gain.shape}"
            )
        check_limit(self.limit)
        whole = with_integrals(self.model, positions_of(self.sensors, self.measured))
        check_stable(
            "integral_gain: the loop",
            whole.A - whole.B @ jnp.concatenate([self.feedback.gain, self.integral_gain], axis=1),
        )

    @property
    def preview(self) -> int:
        """That of the state feedback."""
        return self.feedback.preview

    def design_model(self) -> LinearPlant:
        """Model that it is designed on."""
        return self.model

    def prepare(self, reference: Reference) -> IntegralPlan:
        """The targets."""
        plan = self.feedback.prepare(reference)
        return IntegralPlan(
            plan.state, plan.control, plan.state @ positions_of(self.sensors, self.measured).T
        )

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
        """Correct, control, integrate, predict."""
        filtered = memory.estimate + self.filter_gain @ (
            row(measurement) - self.measured @ memory.estimate
        )
        wanted = plan.control - self.feedback.gain @ (filtered - plan.state) - memory.share
        control = jnp.clip(wanted, -self.limit, self.limit)
        change = (
            self.model.dt
            * self.integral_gain
            @ (self.sensors.positions(measurement) - plan.position)
        )
        further_out = (wanted - control) * change < 0  # the share is subtracted
        share = memory.share + jnp.where(further_out, 0.0, change)
        return IntegralMemory(self.model.step(filtered, control), share), control


def with_integrals(model: LinearPlant, positions: Float[Array, "m n"]) -> LinearPlant:
    """The model beside the integrals of these positions [m s]: the state is [x, w], the output as before."""
    n, m = model.states, positions.shape[0]
    A = jnp.block([[model.A, jnp.zeros((n, m))], [model.dt * positions, jnp.eye(m)]])
    B = jnp.concatenate([model.B, jnp.zeros((m, model.inputs))])
    return LinearPlant(
        A, B, jnp.concatenate([model.C, jnp.zeros((model.axes, m))], axis=1), model.dt
    )


def integral_lq_gains(
    model: LinearPlant,
    positions: Float[Array, "m n"],
    state_weight: Float[Array, "n n"],
    integral_weight: Float[Array, "m m"],
    control_weight: Float[Array, "p p"],
) -> tuple[Float[Array, "p n"], Float[Array, "p m"]]:
    """K and K_i that minimise the sum of x'Q x + w'Q_i w + u'R u.

    Raises:
        ValueError: no stabilising solution of the Riccati equation.
    """
    Q, Q_i = jnp.asarray(state_weight, float), jnp.asarray(integral_weight, float)
    gain = lq_gain(
        with_integrals(model, positions), jax.scipy.linalg.block_diag(Q, Q_i), control_weight
    )
    return gain[:, : model.states], gain[:, model.states :]


def positions_of(sensors: Sensors, measured: Float[Array, "q n"]) -> Float[Array, "m n"]:
    """C_i: how the positions that the sensors show follow from the state."""
    return jax.vmap(sensors.positions, in_axes=1, out_axes=1)(jnp.asarray(measured, float))
