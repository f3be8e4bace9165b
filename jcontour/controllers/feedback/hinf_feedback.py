"""H-infinity feedback by mixed sensitivity, around a moving target.

    z = (W_S (C x + w_2), effort g u),   x+ = A x + B (u + load w_1 / g),   y = C x + w_2
With S = (I - G K)^-1 this bounds W_S S, effort g K S and, by the load w_1, W_S S G and K S G: a
controller that only bounded S and K S would cancel the resonances of the machine. g is the gain of
the machine at the bandwidth w_b. The weight on the sensitivity is

    W_S = (s / M + w_b) / (s + w_b / 1000)     by Tustin's rule
Below gamma = 1, |S| is below M everywhere and below w / w_b beneath the bandwidth. The feedback
acts on what the machine is off its motion, and integrates down to w_b / 1000.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, check_limit
from jcontour.controllers.feedback.hinf_synthesis import Central, Generalised
from jcontour.controllers.feedback.state_feedback import TargetPlan, accelerated_targets
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.sensors import row

LEVELLED = 1e-3  # of the bandwidth: where the weight on the sensitivity levels off


class MixedWeights(NamedTuple):
    """Weights of the mixed sensitivity.

    Attributes:
        bandwidth: w_b [rad/s].
        peak: M, bound on the peak sensitivity at the level one.
        effort: weight on g K S.
        load: load that is borne beside the noise, over that of the machine's gain.
    """

    bandwidth: ArrayLike
    peak: ArrayLike
    effort: ArrayLike
    load: ArrayLike


def gain_at(model: LinearPlant, measured: ArrayLike, bandwidth: float) -> float:
    """Gain g of the machine at a frequency [rad/s], the smallest of its axes."""
    A, B = np.asarray(model.A), np.asarray(model.B)
    z = np.exp(1j * bandwidth * model.dt)
    G = np.asarray(measured) @ np.linalg.solve(z * np.eye(len(A)) - A, B)
    return float(np.linalg.svd(G, compute_uv=False)[-1])


def mixed_sensitivity(
    model: LinearPlant, measured: Float[ArrayLike, "q n"], weights: MixedWeights, gain: float
) -> Generalised:
    """Generalised plant of the weights; `gain` is g, see `gain_at`."""
    A, C, dt = model.A, jnp.asarray(measured, model.A.dtype), model.dt
    (n, p), q = model.B.shape, C.shape[0]
    w_b, M = jnp.asarray(weights.bandwidth, float), jnp.asarray(weights.peak, float)
    slow = w_b * LEVELLED * dt / 2
    pole, direct = (1 - slow) / (1 + slow), (1 / M + w_b * dt / 2) / (1 + slow)
    through = (w_b * dt / 2 - 1 / M) / (1 + slow) + pole * direct  # of the weight's state
    B = model.B / gain
    none = jnp.zeros
    block = [[A, none((n, q))], [through * C, pole * jnp.eye(q)]]
    return Generalised(
        A=jnp.block(block),
        B1=jnp.block([[weights.load * B, none((n, q))], [none((q, p)), through * jnp.eye(q)]]),
        B2=jnp.concatenate([B, none((q, p))]),
        C1=jnp.block([[direct * C, jnp.eye(q)], [none((p, n)), none((p, q))]]),
        D11=jnp.block([[none((q, p)), direct * jnp.eye(q)], [none((p, p)), none((p, q))]]),
        D12=jnp.concatenate([none((q, p)), weights.effort * jnp.eye(p)]),
        C2=jnp.concatenate([C, none((q, q))], axis=1),
        D21=jnp.concatenate([none((q, p)), jnp.eye(q)], axis=1),
    )


class HInfinityFeedback(Controller):
    """Output feedback u = u_d + K (y - C x_d) on the measured positions.

    Args:
        model: of the machine, which its target follows.
        read: rows (q, measured) of the measurement that K reads.
        measured: C (q, n) of what it reads.
        law: central controller of `mixed_sensitivity`, its control in units of 1 / g.
        gain: g.
        limit: limit of the control, +-: the observer in the law is driven by what acts.

    Raises:
        ValueError: as `moving_target`, or a limit is not above zero.
    """

    model: LinearPlant
    read: Float[Array, "q r"]
    measured: Float[Array, "q n"]
    law: Central
    gain: Float[Array, ""]
    limit: Float[Array, "*p"]
    preview: int = eqx.field(static=True, default=2)  # the acceleration needs r(k+2)

    def __init__(
        self,
        model: LinearPlant,
        read: Float[ArrayLike, "q r"],
        measured: Float[ArrayLike, "q n"],
        law: Central,
        gain: float,
        limit: ArrayLike = np.inf,
    ):
        check_limit(limit)
        self.model, self.law, self.preview = model, law, 2
        self.gain = jnp.asarray(gain, float)
        self.read, self.measured = jnp.asarray(read, float), jnp.asarray(measured, float)
        self.limit = jnp.asarray(limit, float)

    def prepare(self, reference: Reference) -> TargetPlan:
        """Measurements C x_d and controls u_d of the motion at every step."""
        plan = accelerated_targets(self.model, reference)
        return TargetPlan(plan.state @ self.measured.T, plan.control)

    def initial_memory(self, reference: Reference) -> Float[Array, " n"]:
        """State of the law: the machine starts as the reference says."""
        return jnp.zeros(self.law.A.shape[0], self.law.A.dtype)

    def step(
        self, memory: Float[Array, " n"], plan: TargetPlan, measurement
    ) -> tuple[Float[Array, " n"], Float[Array, " p"]]:
        """Next state of the law and the control within its limit."""
        law, off = self.law, self.read @ row(measurement) - plan.state
        innovation = off - law.C @ memory
        free = (law.F @ memory + law.D @ innovation) / self.gain
        control = jnp.clip(plan.control + free, -self.limit, self.limit)
        acted = (control - plan.control) * self.gain
        return law.A @ memory + law.B @ acted + law.L @ innovation, control
