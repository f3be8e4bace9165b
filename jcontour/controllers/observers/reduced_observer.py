"""The reduced-order Luenberger observer: only what is not measured is estimated (Yuan, section 4.2.1).

With the state split into the measured part s and the rest, A = [[A11, A12], [A21, A22]], B = [B1;
B2], and z = rest - L_r s,
    z(k+1) = Lambda z + (B2 - L_r B1) u + (Lambda L_r + A21 - L_r A11) s,    Lambda = A22 - L_r A12
    (4.9), (4.10)
The estimation error obeys Lambda. With the thesis's L_r it is stable for the zero-order-hold model
of the axis (|eig| = 0.9972), not for the forward Euler model that the thesis prints (1.00103),
which is refused.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller, Wrapper, check_period
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.motion.references import Reference
from jcontour.sensors import row


class ReducedMemory(NamedTuple):
    """The part z of the estimate, and the memory of the controller inside."""

    z: Float[Array, " n-q"]
    inner: Any


class ReducedObserver(Wrapper):
    """A state-feedback controller fed the measured states as they are, and an estimate of the others.

    Args:
        controller: fed the whole state.
        model: of the machine, its q measured states first.
        gain: L_r (n - q, q).

    Raises:
        ValueError: the gain has another shape, or Lambda has an eigenvalue that is not inside the
            unit circle.
    """

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "n-q q"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        if self.gain.ndim != 2 or sum(self.gain.shape) != self.model.states:
            raise ValueError(
                f"gain: needs shape (n - q, q) with n = {self.model.states}, received {self.gain.shape}"
            )
        check_stable("gain: the observer", error_matrix(self.model, self.gain))

    def design_model(self) -> LinearPlant:
        """Model that it is designed on."""
        return self.model

    def initial_memory(self, reference: Reference) -> ReducedMemory:
        """The state in which the reference begins.

        Raises:
            ValueError: the reference has another sample period.
        """
        check_period(self.model.dt, reference)
        start = self.model.initial_state(reference.position[0], reference.start_increment)
        measured, rest = jnp.split(start, [self.gain.shape[1]])
        return ReducedMemory(rest - self.gain @ measured, self.controller.initial_memory(reference))

    def step(
        self, memory: ReducedMemory, plan: Any, measurement: Any
    ) -> tuple[ReducedMemory, Float[Array, " p"]]:
        """Control on the estimate of now, then eq. 4.10."""
        measured = row(measurement)
        inner, control = self.controller.step(
            memory.inner, plan, jnp.concatenate([measured, memory.z + self.gain @ measured])
        )
        augmented = augmented_model(self.model, self.gain)
        z = (
            augmented.A[measured.size :] @ jnp.concatenate([measured, memory.z])
            + augmented.B[measured.size :] @ control
        )
        return ReducedMemory(z, inner), control


def error_matrix(model: LinearPlant, gain: Float[Array, "n-q q"]) -> Float[Array, "n-q n-q"]:
    """Lambda = A22 - L_r A12: the estimation error of the next sample is Lambda times that of this one (eq. 4.11)."""
    q = gain.shape[1]
    return model.A[q:, q:] - gain @ model.A[:q, q:]


def augmented_model(model: LinearPlant, gain: Float[Array, "n-q q"]) -> LinearPlant:
    """Eq. 4.12: the state is [s, z], the output [s, estimate of the rest], for an estimate without error."""
    q = gain.shape[1]
    to_z = jnp.block([[jnp.eye(q), jnp.zeros(gain.T.shape)], [-gain, jnp.eye(gain.shape[0])]])
    back = jnp.block([[jnp.eye(q), jnp.zeros(gain.T.shape)], [gain, jnp.eye(gain.shape[0])]])
    return LinearPlant(to_z @ model.A @ back, to_z @ model.B, back, model.dt)


def thesis_gain(axes: int = 1) -> Float[np.ndarray, "n-q q"]:
    """L_r as printed in section 4.2.1, for axes side by side."""
    return np.kron([[0.0, 1e-3], [0.0, 1e-3]], np.eye(axes))
