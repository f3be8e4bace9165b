"""Optimal cross-coupled control of the infinite horizon (Kulkarni & Srinivasan 1989).

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

from jcontour._tracing import is_concrete
from jcontour.controller import check_preview
from jcontour.controllers.feedback.state_feedback import accelerated_targets
from jcontour.controllers.lq.contouring_lq import LQWeights, contour_weight, control_weight
from jcontour.controllers.lq.planned_feedback import PlannedFeedback
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain


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
        """Gain and feedforward of every step.

        Raises:
            ValueError: the reference looks less far ahead than the controller.
        """
        check_preview(self, reference)
        model, weights = self.model, self.weights
        R = control_weight(model, weights)

        def gain(tangent: Float[Array, " m"]) -> Float[Array, "p n"]:
            Q = model.C.T @ contour_weight(weights.alpha, weights.beta, tangent) @ model.C
            return lqr_gain(model.A, model.B, dare(model.A, model.B, Q, R), R)

        F = jax.vmap(gain)(reference.tangent[: reference.steps])
        target = accelerated_targets(model, reference)
        return AffinePlan(F, target.control + jnp.einsum("tpn,tn->tp", F, target.state))
