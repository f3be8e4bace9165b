"""Generalised predictive control of the positions around the velocity loops of a cascade.

Every velocity loop is taken for a lag, v' = (v_ref - v) / tau, sampled under zero-order hold:
x = (y, v), x(k+1) = A x + B v_ref. Increments of the command, mu(k) = v_ref(k) - v_ref(k-1), leave
no constant error (Boucher, Dumur & Rahmani 1990, with Clarke's increments). Of the cost

    sum_{j=1..N} (y(k+j) - r(k+j))^2 + lambda sum_{j<M} mu(k+j)^2
the first move is mu(k) = w . r(k+1..k+N) - K (x(k) - x(k-1), y(k)), with constant gains.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._tracing import is_concrete
from jcontour.controller import Controller, check_preview, whole_preview
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference

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
        for name, value in {"lag": lag, "effort": effort}.items():
            if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
        self.cascade, self.preview = cascade, whole_preview(horizon)
        numbers = (jnp.asarray(one, float) for one in (lag, effort))
        each = (jnp.broadcast_to(one, (cascade.sensors.axes,)) for one in numbers)
        gains = jax.vmap(lambda lag, effort: predictive_gains(lag, effort, horizon, cascade.dt))
        self.gains = Predictive(*gains(*each))

    def prepare(self, reference: Reference) -> PredictivePlan:
        """Commands of the cascade, and the weighted reference ahead.

        Raises:
            ValueError: as `Cascade.prepare`, or the reference looks less far ahead.
        """
        check_preview(self, reference)
        steps, ahead = reference.steps, self.gains.ahead
        seen = [reference.position[j : steps + j] for j in range(1, self.preview + 1)]
        wanted = jnp.einsum("jtm,mj->tm", jnp.stack(seen), ahead)
        return PredictivePlan(self.cascade.prepare(reference), wanted)

    def initial_memory(self, reference: Reference) -> Past:
        """The machine has moved as the reference says."""
        speed = reference.start_increment / self.cascade.dt
        before = reference.position[0] - reference.start_increment
        state = jnp.stack([before, speed], axis=-1)
        return Past(self.cascade.initial_memory(reference), state, speed)

    def step(
        self, memory: Past, plan: PredictivePlan, measurement
    ) -> tuple[Past, Float[Array, " m"]]:
        """Next memory and the control within its limit."""
        position, velocity = self.cascade.sensors.read(measurement)
        state = jnp.stack([position, velocity], axis=-1)
        known = jnp.concatenate([state - memory.state, position[:, None]], axis=1)
        mu = plan.wanted - jnp.sum(self.gains.back * known, axis=1)
        command = memory.command + mu
        integral, control = self.cascade.drive(
            memory.integral, command - velocity, plan.command.control
        )
        return Past(integral, state, command), control
