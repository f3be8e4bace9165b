"""Predictive repetitive control: what repeats with a known period leaves no error.

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

from jcontour._tracing import is_concrete
from jcontour.controller import Controller
from jcontour.controllers.feedback.state_feedback import TargetPlan, accelerated_targets
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain


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
        """Targets of every step."""
        return accelerated_targets(self.model, reference)

    def initial_memory(self, reference: Reference) -> Float[Array, " z"]:
        """Resonators at rest."""
        return jnp.zeros(self.internal.A.shape[0], self.gain.dtype)

    def step(
        self, memory: Float[Array, " z"], plan: TargetPlan, measurement: Float[Array, " n"]
    ) -> tuple[Float[Array, " z"], Float[Array, " p"]]:
        """Next resonators, and the control."""
        off = measurement - plan.state
        control = plan.control - self.gain @ jnp.concatenate([off, memory])
        return self.internal.A @ memory + self.internal.B @ (self.model.C @ off), control
