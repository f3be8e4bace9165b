"""Finite-preview LQ tracking (Tomizuka & Whitney, as McNab & Tsao use it for comparison).

The infinite-horizon problem with a fixed weight Q = alpha I is solved once; the next N_p samples
enter through constant feedforward gains, and the path continues beyond them at its last speed:

    u(k) = -K x(k) - G_N x_d(k+N_p) + sum_{j=1}^{N_p-1} G_j y_d(k+j)
    G_j = (B'HB + R)^-1 B' (A_c')^{j-1} C'Q,   A_c = A - B K
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete
from jcontour.controller import whole_preview
from jcontour.controllers.lq.planned_feedback import ModelFeedback
from jcontour.linear.plant import AffinePlan, LinearPlant, SteadyMotion, steady_motion
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain, small_inverse


class PreviewLQ(ModelFeedback):
    """Time-invariant feedback and preview; it cannot tell contour error from tracking error.

    >>> from jcontour.plants.bridgeport import bridgeport
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
        for name, weight in (("alpha", self.alpha), ("rho", self.rho)):
            if is_concrete(weight) and not 0 < float(weight) < np.inf:
                raise ValueError(f"{name}: needs a finite weight above zero, received {weight}")
        check_dare(model.A, model.B, *self._cost())

    def gain_schedule(self, reference: Reference) -> AffinePlan:
        """Constant gain, and feedforward of every step."""
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
