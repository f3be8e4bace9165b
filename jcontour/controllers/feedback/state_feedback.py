"""State feedback towards a steady target: u = u_d - K (x - x_d) (Yuan, section 2.2.3).

The quasi-steady target of the thesis treats the reference as if it stood still:

    [A - I, B; C, 0] [x_d; u_d] = [0; y]
It lags behind a moving reference, because x_d is at rest. The moving target solves the same
equations for steady motion,

    x_d = N_y y + N_v dy,   u_d = U_y y + U_v dy,   dy = y(k+1) - y(k)
    [A - I, B; C, 0] [N_v; U_v] = [N_y; 0]
so that a model of the machine follows a ramp without error.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._tracing import is_concrete
from jcontour.controller import Controller
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain


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
        """Targets of every step."""
        steps, target = reference.steps, self.target
        y, later = reference.position[:steps], reference.position[1 : steps + 1]
        dy = later - y
        state = y @ target.state.T + dy @ target.state_moving.T
        return TargetPlan(state, y @ target.control.T + dy @ target.control_moving.T)

    def initial_memory(self, reference: Reference) -> None:
        """None: the controller has no memory."""
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
        return jnp.linalg.solve(scaled, jnp.concatenate([state, output])) / largest[:, None]

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
    third = jnp.linalg.solve(scaled, right) / largest[:, None]
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
