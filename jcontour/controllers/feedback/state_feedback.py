"""State feedback towards a steady target, and LQG with integral action.

    u = u_d - K (x - x_d)                                           (Yuan, section 2.2.3)

The quasi-steady target of the thesis treats the reference as if it stood still:

    [A - I, B; C, 0] [x_d; u_d] = [0; y]
It lags behind a moving reference, because x_d is at rest. The moving target solves the same
equations for steady motion,

    x_d = N_y y + N_v dy,   u_d = U_y y + U_v dy,   dy = y(k+1) - y(k)
    [A - I, B; C, 0] [N_v; U_v] = [N_y; 0]
so that a model of the machine follows a ramp without error.

LQG integrates the measured position error.

    u = u_d - K (xf - x_d) - K_i w,     w(k+1) = w(k) + T (y_i - C_i x_d)
y_i are the measured positions to be reached, C_i their rows of the model, and xf is the filtered
estimate of `kalman`. K and K_i are the LQ gain of the model with its integrals,

    [x; w](k+1) = [A, 0; T C_i, I] [x; w] + [B; 0] u.
The measurement is integrated, not the estimate: a load or a wrong input gain biases the estimate,
and its integral would settle at the biased value. Without the integral both leave an error at rest
and in steady motion; with it they leave none. The integral is kept as its share K_i w of the
control. While a control is at its limit, its share holds still as long as it would drive the
control further out. The filter reads the control that acts. So neither of them winds up.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import is_concrete
from jcontour.controller import Controller, check_limit, check_period
from jcontour.controllers.observers.kalman import check_gain
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.linear.small_matrices import small_solve
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain
from jcontour.sensors import Sensors, row


class SteadyTarget(eqx.Module):
    """Maps from position y [m] and increment dy [m per sample] of the tool to state and control."""

    state: Float[Array, "n m"]  # N_y
    control: Float[Array, "p m"]  # U_y
    state_moving: Float[Array, "n m"]  # N_v
    control_moving: Float[Array, "p m"]  # U_v


class TargetPlan(eqx.Module):
    """Targets of every step."""

    state: Float[Array, "T n"]  # x_d
    control: Float[Array, "T p"]  # u_d


class StateFeedback(Controller):
    """State feedback u = u_d - K (x - x_d); the measurement is the state, true or estimated.

    >>> from jcontour.plants.xy_table import xy_table
    >>> table = xy_table(1e-3)
    >>> gain = lq_gain(table, 1e6 * table.C.T @ table.C, jnp.eye(2))
    >>> controller = StateFeedback(gain, moving_target(table))
    >>> controller.gain.shape, controller.preview
    ((2, 8), 1)

    Args:
        gain: K (p, n).
        target: map from the reference to x_d and u_d.

    Raises:
        ValueError: the gain has another shape than the target asks for, or is not finite.
    """

    gain: Float[Array, "p n"] = eqx.field(converter=jnp.asarray)
    target: SteadyTarget
    preview: int = eqx.field(static=True, default=1)

    def __check_init__(self):
        wanted = (self.target.control.shape[0], self.target.state.shape[0])
        if self.gain.shape != wanted:
            raise ValueError(f"gain: needs shape {wanted}, received {self.gain.shape}")
        if is_concrete(self.gain) and not np.isfinite(self.gain).all():
            raise ValueError("gain: every entry needs to be finite, received NaN or inf")

    def prepare(self, reference: Reference) -> TargetPlan:
        steps, target = reference.steps, self.target
        y, later = reference.position[:steps], reference.position[1 : steps + 1]
        dy = later - y
        state = y @ target.state.T + dy @ target.state_moving.T
        return TargetPlan(state, y @ target.control.T + dy @ target.control_moving.T)

    def initial_memory(self, reference: Reference) -> None:
        return None

    def step(
        self, memory: None, plan: TargetPlan, measurement: Float[Array, " n"]
    ) -> tuple[None, Float[Array, " p"]]:
        """Control u = u_d - K (x - x_d)."""
        return None, plan.control - self.gain @ (measurement - plan.state)


def quasi_steady_target(model: LinearPlant) -> SteadyTarget:
    """Target of the thesis: at rest wherever the reference is.

    Raises:
        ValueError: as `moving_target`.
    """
    steady = moving_target(model)
    no_state = jnp.zeros_like(steady.state_moving)
    no_control = jnp.zeros_like(steady.control_moving)
    return SteadyTarget(steady.state, steady.control, no_state, no_control)


def moving_target(model: LinearPlant) -> SteadyTarget:
    """Target in steady motion.

    Raises:
        ValueError: there are not as many controls as outputs, or the machine cannot hold every
            position (a zero at z = 1).
    """
    p, m = model.inputs, model.axes
    if p != m:
        raise ValueError(
            f"model: a steady target needs as many controls as outputs, received {p} and {m}"
        )
    target, scaled = _moving_target(model.A, model.B, model.C)
    if is_concrete(scaled) and not np.linalg.cond(np.asarray(scaled)) * np.finfo(float).eps < 1:
        raise ValueError(
            "model: the machine cannot hold every position, its steady equations are singular"
        )
    return target


def _steady_matrix(A: Array, B: Array, C: Array) -> Float[Array, "s s"]:
    n, m = A.shape[0], C.shape[0]
    return jnp.block([[A - jnp.eye(n), B], [C, jnp.zeros((m, m))]])


@jax.jit
def _moving_target(A: Array, B: Array, C: Array) -> tuple[SteadyTarget, Float[Array, "s s"]]:
    """Target and the matrix of its equations."""
    n, m = A.shape[0], C.shape[0]
    matrix = _steady_matrix(A, B, C)
    # each column is scaled to 1: metres, metres per second and amperes differ much
    largest = jnp.max(jnp.abs(matrix), axis=0)
    scaled = matrix / largest[None]

    def solve(state, output):
        return small_solve(scaled, jnp.concatenate([state, output])) / largest[:, None]

    rest = solve(jnp.zeros((n, m)), jnp.eye(m))
    motion = solve(rest[:n], jnp.zeros((m, m)))
    return SteadyTarget(rest[:n], rest[n:], motion[:n], motion[n:]), scaled


def accelerated_targets(model: LinearPlant, reference: Reference) -> TargetPlan:
    """Targets of every step with the acceleration of the reference, so that arcs leave no lag.

        x_d = N_y y + N_v dy + N_a d2y,   [A - I, B; C, 0] [N_a; U_a] = [N_v; 0]
    The reference needs two samples of preview.

    Raises:
        ValueError: as `moving_target`.
    """
    target = moving_target(model)
    _, scaled = _moving_target(model.A, model.B, model.C)
    none = jnp.zeros((model.axes, model.axes))
    right = jnp.concatenate([target.state_moving, none])
    largest = jnp.max(jnp.abs(_steady_matrix(model.A, model.B, model.C)), axis=0)
    third = small_solve(scaled, right) / largest[:, None]
    y = reference.position[: reference.steps + 2]
    dy = jnp.diff(y, axis=0)
    motion = jnp.concatenate([y[:-2], dy[:-1], jnp.diff(dy, axis=0)], axis=1)
    n = model.states
    state = jnp.concatenate([target.state, target.state_moving, third[:n]], axis=1)
    control = jnp.concatenate([target.control, target.control_moving, third[n:]], axis=1)
    return TargetPlan(motion @ state.T, motion @ control.T)


def lq_gain(
    model: LinearPlant,
    state_weight: Float[ArrayLike, "n n"],
    control_weight: Float[ArrayLike, "p p"],
) -> Float[Array, "p n"]:
    """Gain K that minimises the sum of x'Q x + u'R u (Yuan, eq. 2.12, deterministic form).

    Raises:
        ValueError: no stabilising solution of the Riccati equation.
    """
    Q, R = jnp.asarray(state_weight, float), jnp.asarray(control_weight, float)
    check_dare(model.A, model.B, Q, R)
    return lqr_gain(model.A, model.B, dare(model.A, model.B, Q, R), R)


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
        return self.feedback.preview

    def prepare(self, reference: Reference) -> IntegralPlan:
        plan = self.feedback.prepare(reference)
        position = plan.state @ positions_of(self.sensors, self.measured).T
        return IntegralPlan(plan.state, plan.control, position)

    def initial_memory(self, reference: Reference) -> IntegralMemory:
        """The estimate starts where the reference says the run begins, the integral at zero."""
        check_period(self.model.dt, reference)
        start = self.model.initial_state(reference.position[0], reference.start_increment)
        return IntegralMemory(start, jnp.zeros(self.model.inputs, start.dtype))

    def step(
        self, memory: IntegralMemory, plan: IntegralPlan, measurement: Any
    ) -> tuple[IntegralMemory, Float[Array, " p"]]:
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
