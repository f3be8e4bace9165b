"""Predictive control without constraints: around a cascade, and of what repeats.

Generalised predictive control of the positions works around the velocity loops of a cascade.

Every velocity loop is taken for a lag, v' = (v_ref - v) / tau, sampled under zero-order hold:
x = (y, v), x(k+1) = A x + B v_ref. Increments of the command, mu(k) = v_ref(k) - v_ref(k-1), leave
no constant error (Boucher, Dumur & Rahmani 1990, with Clarke's increments). Of the cost

    sum_{j=1..N} (y(k+j) - r(k+j))^2 + lambda sum_{j<M} mu(k+j)^2
the first move is mu(k) = w . r(k+1..k+N) - K (x(k) - x(k-1), y(k)), with constant gains.

Under predictive repetitive control what repeats with a known period leaves no error.

    z_h(k+1) = Rot(h w T) z_h(k) + (0, y - y_d),   h = 1..harmonics, for every axis
    u = u_d - K (x - x_d, z),   cost  sum |x - x_d|^2_Q + repetition |z|^2 + |u - u_d|^2_R
The resonators are the internal model of a period 2 pi / w. The horizon of the cost is endless and
there are no constraints, so the gains are constant: Wang, Freeman, Chai & Rogers (2013) have both,
and filter the model by their internal model, which bears no error of the model. Driven by the error
the loop is that of a regulator with more states.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import check_above_zero, is_concrete
from jcontour.controller import Controller, check_preview, whole_preview
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.controllers.feedback.state_feedback import TargetPlan, accelerated_targets
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain

MOVES = 4  # M: changes of the command that are free; later ones are zero


class Predictive(NamedTuple):
    """Gains of every axis: w on the reference, K on the change of (y, v) and on y."""

    ahead: Float[Array, "m N"]
    back: Float[Array, "m 3"]


class PredictivePlan(eqx.Module):
    """Commands of the cascade, and w . r of every step."""

    command: CascadePlan
    wanted: Float[Array, "*T m"]


class Past(NamedTuple):
    """Integrators of the cascade, and the last states (y, v) and commands [m/s]."""

    integral: Float[Array, " m"]
    state: Float[Array, "m 2"]
    command: Float[Array, " m"]


def predictive_gains(
    lag: ArrayLike, effort: ArrayLike, horizon: int, dt: float
) -> tuple[Float[Array, " N"], Float[Array, "3"]]:
    """Gains w and K of one axis.

    Args:
        lag: tau of the velocity loop [s].
        effort: lambda, in m^2 per (m/s)^2.
        horizon: N [samples].
        dt: sample period [s].
    """
    tau = jnp.asarray(lag, float)
    stays = jnp.exp(-dt / tau)
    moved, one, none = tau * (1 - stays), jnp.ones(()), jnp.zeros(())
    # (change of y, change of v, y) one sample later: the increment acts like the command
    rows = [[one, moved, none], [none, stays, none], [one, moved, one]]
    A = jnp.stack([jnp.stack(row) for row in rows])
    B = jnp.stack([dt - moved, 1 - stays, dt - moved])

    def one_on(carry, _):
        free, response = carry  # y(k+j) = free z + sum of responses
        free = free @ A
        return (free, A @ response), (free, response[2])

    start = jnp.array([0.0, 0.0, 1.0]), B
    _, (free, impulse) = jax.lax.scan(one_on, start, length=horizon)
    late = np.subtract.outer(np.arange(horizon), np.arange(min(MOVES, horizon)))
    G = jnp.where(late >= 0, impulse[np.maximum(late, 0)], 0.0)
    ahead = jnp.linalg.solve(G.T @ G + effort * jnp.eye(G.shape[1]), G.T)[0]
    return ahead, ahead @ free


class PredictiveCascade(Controller):
    """A cascade whose position loops are predictive.

    Args:
        cascade: the axes; its position gains and its speed feedforward are not used.
        lag: tau [s] of the velocity loops, one number or one for each axis.
        effort: lambda [s^2], likewise.
        horizon: N [samples].

    Raises:
        ValueError: the lag or the effort is not above zero, or the horizon is no whole number of
            at least one sample.
    """

    cascade: Cascade
    gains: Predictive
    preview: int = eqx.field(static=True)

    def __init__(self, cascade: Cascade, lag: ArrayLike, effort: ArrayLike, horizon: int):
        check_above_zero(lag=lag, effort=effort)
        self.cascade, self.preview = cascade, whole_preview(horizon)
        numbers = (jnp.asarray(one, float) for one in (lag, effort))
        each = (jnp.broadcast_to(one, (cascade.sensors.axes,)) for one in numbers)
        gains = jax.vmap(lambda lag, effort: predictive_gains(lag, effort, horizon, cascade.dt))
        self.gains = Predictive(*gains(*each))

    def prepare(self, reference: Reference) -> PredictivePlan:
        check_preview(self, reference)
        steps, ahead = reference.steps, self.gains.ahead
        seen = [reference.position[j : steps + j] for j in range(1, self.preview + 1)]
        wanted = jnp.einsum("jtm,mj->tm", jnp.stack(seen), ahead)
        return PredictivePlan(self.cascade.prepare(reference), wanted)

    def initial_memory(self, reference: Reference) -> Past:
        speed = reference.start_increment / self.cascade.dt
        before = reference.position[0] - reference.start_increment
        state = jnp.stack([before, speed], axis=-1)
        return Past(self.cascade.initial_memory(reference), state, speed)

    def step(
        self, memory: Past, plan: PredictivePlan, measurement
    ) -> tuple[Past, Float[Array, " m"]]:
        position, velocity = self.cascade.sensors.read(measurement)
        state = jnp.stack([position, velocity], axis=-1)
        known = jnp.concatenate([state - memory.state, position[:, None]], axis=1)
        mu = plan.wanted - jnp.sum(self.gains.back * known, axis=1)
        command = memory.command + mu
        integral, control = self.cascade.drive(
            memory.integral, command - velocity, plan.command.control
        )
        return Past(integral, state, command), control


class Resonators(NamedTuple):
    """Internal model z+ = A z + B e of the errors of m axes."""

    A: Float[Array, "z z"]
    B: Float[Array, "z m"]


def resonators(turn: ArrayLike, harmonics: int, axes: int) -> Resonators:
    """Rotations by the angles h w T; `turn` is w T [rad]."""
    angle = jnp.arange(1.0, harmonics + 1) * jnp.asarray(turn, float)
    c, s = jnp.cos(angle), jnp.sin(angle)
    rows = jnp.stack([jnp.stack([c, s], axis=-1), jnp.stack([-s, c], axis=-1)], axis=-2)
    eye = jnp.eye(axes)
    A = jax.scipy.linalg.block_diag(*(jnp.kron(eye, rows[h]) for h in range(harmonics)))
    entry = jnp.kron(eye, jnp.array([[0.0], [1.0]]))
    return Resonators(A, jnp.tile(entry, (harmonics, 1)))


class PredictiveRepetitive(Controller):
    """State feedback with resonators of the error; the measurement is the state of the model.

    Args:
        model: A, B, C.
        Q: weight on the state (n, n).
        R: weight on the controls (p, p).
        repetition: weight on the resonators.
        turn: w T [rad], the turn of the period in a sample.
        harmonics: how many of the period leave no error.

    Raises:
        ValueError: as `moving_target`; there is no harmonic, or the Riccati equation has no
            stabilising solution: the machine has a zero at a harmonic.
    """

    model: LinearPlant
    internal: Resonators
    gain: Float[Array, "p both"]
    preview: int = eqx.field(static=True, default=2)  # the target's acceleration needs r(k+2)

    def __init__(
        self,
        model: LinearPlant,
        Q: Float[ArrayLike, "n n"],
        R: Float[ArrayLike, "p p"],
        repetition: ArrayLike,
        turn: ArrayLike,
        harmonics: int = 1,
    ):
        if harmonics < 1:
            raise ValueError(f"harmonics: needs at least one, received {harmonics}")
        if is_concrete(turn) and not 0 < harmonics * float(np.asarray(turn)) < np.pi:
            raise ValueError(f"turn: harmonics need to be between 0 and pi, the first is at {turn}")
        self.model, self.preview = model, 2
        self.internal = inner = resonators(turn, harmonics, model.axes)
        n, count, p = model.states, inner.A.shape[0], model.inputs
        A = jnp.block([[model.A, jnp.zeros((n, count))], [inner.B @ model.C, inner.A]])
        B = jnp.concatenate([model.B, jnp.zeros((count, p))])
        weight = jax.scipy.linalg.block_diag(
            jnp.asarray(Q, float), jnp.asarray(repetition, float) * jnp.eye(count)
        )
        check_dare(A, B, weight, R)
        R = jnp.asarray(R, float)
        self.gain = lqr_gain(A, B, dare(A, B, weight, R), R)

    def prepare(self, reference: Reference) -> TargetPlan:
        return accelerated_targets(self.model, reference)

    def initial_memory(self, reference: Reference) -> Float[Array, " z"]:
        return jnp.zeros(self.internal.A.shape[0], self.gain.dtype)

    def step(
        self, memory: Float[Array, " z"], plan: TargetPlan, measurement: Float[Array, " n"]
    ) -> tuple[Float[Array, " z"], Float[Array, " p"]]:
        off = measurement - plan.state
        control = plan.control - self.gain @ jnp.concatenate([off, memory])
        return self.internal.A @ memory + self.internal.B @ (self.model.C @ off), control
