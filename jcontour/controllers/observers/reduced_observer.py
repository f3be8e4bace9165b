"""Reduced-order Luenberger observer: it estimates the unmeasured states (Yuan, section 4.2.1).

The state is split into the measured part s and the rest, A = [[A11, A12], [A21, A22]],
B = [B1; B2]. With z = rest - L_r s,

    Lambda = A22 - L_r A12                                                     (4.9)
    z(k+1) = Lambda z + (B2 - L_r B1) u + (Lambda L_r + A21 - L_r A11) s       (4.10)
The estimation error obeys Lambda. With the thesis's L_r it is stable for the zero-order-hold model
of the axis (|eig| = 0.9972), not for the forward Euler model that the thesis prints (1.00103),
which is refused.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, Wrapper, check_period
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.motion.references import Reference
from jcontour.sensors import row


class ReducedMemory(NamedTuple):
    """The part z of the estimate (n - q,), and the memory of the wrapped controller."""

    z: Float[Array, " rest"]
    inner: Any


class ReducedObserver(Wrapper):
    """A state-feedback controller fed the measured states and an estimate of the others.

    Args:
        controller: fed the whole state.
        model: model of the machine, its q measured states first.
        gain: L_r (n - q, q).

    Raises:
        ValueError: the gain has another shape, or Lambda has an eigenvalue that is not inside the
            unit circle.
    """

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "rest q"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        states, found = self.model.states, self.gain.shape
        if self.gain.ndim != 2 or sum(found) != states:
            raise ValueError(f"gain: needs shape (n - q, q) with n = {states}, received {found}")
        check_stable("gain: the observer", error_matrix(self.model, self.gain))

    def initial_memory(self, reference: Reference) -> ReducedMemory:
        """Memory in the state in which the reference begins.

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
        """Control on the present estimate, then eq. 4.10."""
        measured = row(measurement)
        q = measured.size
        estimate = jnp.concatenate([measured, memory.z + self.gain @ measured])
        inner, control = self.controller.step(memory.inner, plan, estimate)
        augmented = augmented_model(self.model, self.gain)
        known = jnp.concatenate([measured, memory.z])
        z = augmented.A[q:] @ known + augmented.B[q:] @ control
        return ReducedMemory(z, inner), control


def error_matrix(model: LinearPlant, gain: Float[ArrayLike, "rest q"]) -> Float[Array, "rest rest"]:
    """Lambda = A22 - L_r A12, by which the estimation error moves on in a sample (eq. 4.11)."""
    gain = jnp.asarray(gain)
    q = gain.shape[1]
    return model.A[q:, q:] - gain @ model.A[:q, q:]


def augmented_model(model: LinearPlant, gain: Float[ArrayLike, "rest q"]) -> LinearPlant:
    """Model with the state [s, z] and the output [s, estimate of the rest] (eq. 4.12).

    It holds for an estimate without error.
    """
    gain = jnp.asarray(gain)
    q = gain.shape[1]
    to_z = jnp.block([[jnp.eye(q), jnp.zeros(gain.T.shape)], [-gain, jnp.eye(gain.shape[0])]])
    back = jnp.block([[jnp.eye(q), jnp.zeros(gain.T.shape)], [gain, jnp.eye(gain.shape[0])]])
    return LinearPlant(to_z @ model.A @ back, to_z @ model.B, back, model.dt)


def thesis_gain(axes: int = 1) -> Float[np.ndarray, "rest q"]:
    """Gain L_r as printed in section 4.2.1, for axes side by side."""
    return np.kron([[0.0, 1e-3], [0.0, 1e-3]], np.eye(axes))
