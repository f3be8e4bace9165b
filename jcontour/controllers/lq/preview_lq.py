"""LQ laws of the infinite horizon, with which McNab & Tsao compare.

Finite-preview LQ tracking (Tomizuka & Whitney): the infinite-horizon problem with a fixed weight Q
= alpha I is solved once; the next N_p samples enter through constant feedforward gains, and the
path continues beyond them at its last speed:

    u(k) = -K x(k) - G_N x_d(k+N_p) + sum_{j=1}^{N_p-1} G_j y_d(k+j)
    G_j = (B'HB + R)^-1 B' (A_c')^{j-1} C'Q,   A_c = A - B K

Optimal cross-coupled control (Kulkarni & Srinivasan 1989):

    u = u_d - K(theta) (x - x_d),   K(theta) = (B'H B + R)^-1 B'H A
with H of the Riccati equation for the weight C' (alpha I + beta n n') C of the tracking and the
contour error, n the normal at the angle theta of the path. The gain is that of an endless straight
line in this direction. It sees nothing ahead but the speed and the acceleration of the reference,
which its target needs; their proportional tracking loop and its command are that target here.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour._arrays import check_signs, is_concrete
from jcontour.controller import check_preview, whole_preview
from jcontour.controllers.feedback.state_feedback import accelerated_targets
from jcontour.controllers.lq.contouring_lq import (
    LQWeights,
    ModelFeedback,
    PlannedFeedback,
    contour_weight,
    control_weight,
)
from jcontour.linear.plant import AffinePlan, LinearPlant, SteadyMotion, steady_motion
from jcontour.linear.small_matrices import small_inverse
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain


class PreviewLQ(ModelFeedback):
    """Time-invariant feedback and preview; it cannot tell contour error from tracking error.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> controller = PreviewLQ(bridgeport(), alpha=1e8, rho=1e-2, preview=10)
    >>> controller.preview, float(controller.alpha)
    (10, 100000000.0)

    Args:
        model: model of the machine; the measurement is its state.
        alpha: weight on the tracking error [1/m^2].
        rho: weight on the control [1/control unit^2].
        preview: samples of the future it uses.
        motion: maps from steady motion to the state; derived per decoupled axis when not given.

    Raises:
        ValueError: preview < 1, a weight that is not above zero, or no stabilising solution of the
            Riccati equation.
    """

    model: LinearPlant
    alpha: Float[Array, ""]
    rho: Float[Array, ""]
    preview: int = eqx.field(static=True)
    motion: SteadyMotion | None

    def __init__(
        self, model: LinearPlant, alpha, rho, preview: int, motion: SteadyMotion | None = None
    ):
        self.model, self.preview, self.motion = model, whole_preview(preview), motion
        self.alpha, self.rho = jnp.asarray(alpha, model.A.dtype), jnp.asarray(rho, model.A.dtype)
        check_signs(self, positive=("alpha", "rho"))
        check_dare(model.A, model.B, *self._cost())

    def gain_schedule(self, reference: Reference) -> AffinePlan:
        A, B, C = self.model.A, self.model.B, self.model.C
        Q, R = self._cost()
        H = dare(A, B, Q, R)
        K = lqr_gain(A, B, H, R)
        motion = steady_motion(self.model) if self.motion is None else self.motion
        position, first, last = reference.position, self.preview, self.preview + reference.steps
        end = jax.lax.slice_in_dim(position, first, last)
        before = jax.lax.slice_in_dim(position, first - 1, last - 1)

        def add_sample(carry, j):
            costate, f = carry  # costate: (A_c')^(j-1), mapped through the first control
            y_d = jax.lax.dynamic_slice_in_dim(reference.position, j, reference.steps)
            return (costate @ (A - B @ K).T, f + y_d @ (costate @ C.T * self.alpha).T), None

        first = small_inverse(B.T @ H @ B + R) @ B.T
        start = (first, jnp.zeros((reference.steps, self.model.inputs), A.dtype))
        (costate, f), _ = jax.lax.scan(add_sample, start, jnp.arange(1, self.preview))
        f = f + motion.state(end, end - before) @ (costate @ H).T
        return AffinePlan(jnp.broadcast_to(K, (reference.steps, *K.shape)), f)

    def _cost(self) -> tuple[Float[Array, "n n"], Float[Array, "p p"]]:
        C = self.model.C
        R = self.rho * jnp.eye(self.model.inputs, dtype=self.model.A.dtype)
        return self.alpha * C.T @ C, R


class CrossCoupledLQ(PlannedFeedback):
    """Controller u = f - F x with the gain of the path's direction at every sample.

    Args:
        model: of the machine; the measurement is its state.
        weights: alpha, beta, rho.

    Raises:
        ValueError: as `moving_target`, or the Riccati equation has no stabilising solution.
    """

    model: LinearPlant
    weights: LQWeights
    preview: int = eqx.field(static=True, default=2)  # the acceleration needs r(k+2)

    def __init__(self, model: LinearPlant, weights: LQWeights):
        self.model, self.weights, self.preview = model, weights, 2
        if is_concrete(*jax.tree.leaves((model, weights))):
            Q = weights.alpha * model.C.T @ model.C
            check_dare(model.A, model.B, Q, control_weight(model, weights))

    def prepare(self, reference: Reference) -> AffinePlan:
        check_preview(self, reference)
        model, weights = self.model, self.weights
        R = control_weight(model, weights)

        def gain(tangent: Float[Array, " m"]) -> Float[Array, "p n"]:
            Q = model.C.T @ contour_weight(weights.alpha, weights.beta, tangent) @ model.C
            return lqr_gain(model.A, model.B, dare(model.A, model.B, Q, R), R)

        F = jax.vmap(gain)(reference.tangent[: reference.steps])
        target = accelerated_targets(model, reference)
        return AffinePlan(F, target.control + jnp.einsum("tpn,tn->tp", F, target.state))
