"""Unconstrained predictive control of the positions around the velocity loops of a cascade.

Every velocity loop is taken for a lag, v' = (v_ref - v) / tau, sampled under zero-order hold:
x = (y, v), x(k+1) = A x + B v_ref. An internal model D(q) kills what has to leave no error,

    D = (1 - q^-1) prod_h (1 - 2 cos(h w T) q^-1 + q^-2),   xi = D x,   mu = D v_ref
With none of the factors h it is generalised predictive control in a cascade (Boucher, Dumur &
Rahmani 1990; Clarke's increments). With the first ones of a period 2 pi / w it is predictive
repetitive control (Wang, Freeman, Chai & Rogers 2013, without their constraints). Of the cost

    sum_{j=1..N} (y(k+j) - r(k+j))^2 + lambda sum_{j<M} mu(k+j)^2
the first move is mu(k) = w . r(k+1..k+N) - K (xi, y(k), ..., y(k+1-deg D)), with constant gains.
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
    """Gains of every axis and the internal model.

    Attributes:
        ahead: w (m, N) on the reference.
        back: K (m, 2 + d) on xi and the last d positions.
        polynomial: d coefficients of D after the leading one.
    """

    ahead: Float[Array, "m N"]
    back: Float[Array, "m back"]
    polynomial: Float[Array, " d"]


class PredictivePlan(eqx.Module):
    """Commands of the cascade, and w . r of every step."""

    command: CascadePlan
    wanted: Float[Array, "*T m"]


class Past(NamedTuple):
    """Integrators of the cascade, and the last d states and commands, the newest first."""

    integral: Float[Array, " m"]
    states: Float[Array, "d m 2"]
    commands: Float[Array, "d m"]


def internal_model(turn: ArrayLike, harmonics: int) -> Float[Array, " d"]:
    """Coefficients of D(q) after its leading one; `turn` is w T [rad]."""
    polynomial = jnp.array([1.0, -1.0])
    for h in range(1, harmonics + 1):
        factor = jnp.stack([jnp.ones(()), -2 * jnp.cos(h * jnp.asarray(turn, float)), jnp.ones(())])
        polynomial = jnp.convolve(polynomial, factor)
    return polynomial[1:]


def predictive_gains(
    lag: ArrayLike,
    effort: ArrayLike,
    polynomial: Float[Array, " d"],
    horizon: int,
    dt: float,
) -> tuple[Float[Array, " N"], Float[Array, " back"]]:
    """Gains w and K of one axis.

    Args:
        lag: tau of the velocity loop [s].
        effort: lambda, in m^2 per (m/s)^2.
        polynomial: see `internal_model`.
        horizon: N [samples].
        dt: sample period [s].
    """
    tau, d = jnp.asarray(lag, float), polynomial.size
    stays = jnp.exp(-dt / tau)
    moved, one, none = tau * (1 - stays), jnp.ones(()), jnp.zeros(())
    A = jnp.stack([jnp.stack([one, moved]), jnp.stack([none, stays])])
    B = jnp.stack([dt - moved, 1 - stays])
    # (xi, y(k), ..., y(k+1-d)) one sample later: y(k+1) = xi_y(k+1) - sum d_i y(k+1-i)
    rows = (
        jnp.zeros((2 + d, 2 + d)).at[:2, :2].set(A).at[2, :2].set(A[0]).at[2, 2:].set(-polynomial)
    )
    rows = rows.at[3:, 2:-1].set(jnp.eye(d - 1))
    entry = jnp.zeros(2 + d).at[:2].set(B).at[2].set(B[0])

    def one_on(carry, _):
        free, response = carry  # y(k+j) = free z + sum of responses
        free, response = free @ rows, rows @ response
        return (free, response), (free, response[2])

    first = jnp.zeros(2 + d).at[2].set(1.0)
    _, (free, later) = jax.lax.scan(one_on, (first, entry), length=horizon)
    impulse = jnp.concatenate([entry[2:3], later[:-1]])
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
        turn: w T [rad], the turn of the period in a sample; zero without harmonics.
        harmonics: how many of the period leave no error.

    Raises:
        ValueError: the lag or the effort is not above zero, or the horizon is no whole number of
            at least one sample.
    """

    cascade: Cascade
    gains: Predictive
    preview: int = eqx.field(static=True)

    def __init__(
        self,
        cascade: Cascade,
        lag: ArrayLike,
        effort: ArrayLike,
        horizon: int,
        turn: ArrayLike = 0.0,
        harmonics: int = 0,
    ):
        for name, value in {"lag": lag, "effort": effort}.items():
            if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
        self.cascade, self.preview = cascade, whole_preview(horizon)
        polynomial, axes = internal_model(turn, harmonics), cascade.sensors.axes
        ahead, back = jax.vmap(
            lambda lag, effort: predictive_gains(lag, effort, polynomial, self.preview, cascade.dt)
        )(*(jnp.broadcast_to(jnp.asarray(one, float), (axes,)) for one in (lag, effort)))
        self.gains = Predictive(ahead, back, polynomial)

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
        """The machine has moved as the reference says for ever."""
        d, dt = self.gains.polynomial.size, self.cascade.dt
        speed = jnp.broadcast_to(reference.start_increment / dt, (d, reference.position.shape[1]))
        back = jnp.arange(1.0, d + 1)[:, None] * reference.start_increment[None]
        states = jnp.stack([reference.position[:1] - back, speed], axis=-1)
        return Past(self.cascade.initial_memory(reference), states, speed)

    def step(
        self, memory: Past, plan: PredictivePlan, measurement
    ) -> tuple[Past, Float[Array, " m"]]:
        """Next memory and the control within its limit."""
        gains = self.gains
        position, velocity = self.cascade.sensors.read(measurement)
        state = jnp.stack([position, velocity], axis=-1)
        xi = state + jnp.einsum("d,dmi->mi", gains.polynomial, memory.states)
        outputs = jnp.concatenate([position[None], memory.states[:-1, :, 0]]).T
        known = jnp.concatenate([xi, outputs], axis=1)
        mu = plan.wanted - jnp.sum(gains.back * known, axis=1)
        command = mu - gains.polynomial @ memory.commands
        integral, control = self.cascade.drive(
            memory.integral, command - velocity, plan.command.control
        )
        past = (
            jnp.concatenate([new[None], old[:-1]])
            for new, old in ((state, memory.states), (command, memory.commands))
        )
        return Past(integral, *past), control
