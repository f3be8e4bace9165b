"""Finite impulse responses of a model to its disturbances, and the peaks of signals under them.

A policy that answers every disturbance w(k) with X_j w(k) in the state and U_j w(k) in the control,
j samples later, makes

    X_0 = E,   X_{j+1} = A X_j + B U_j,   X_N = 0.
The largest value of a signal c x + d u under |w_i| <= 1 is its peak, the l1 norm of its response:

    sum_{j<N} |c X_j + d U_j|_1.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jcontour.sets.disturbed_model import DisturbedModel, Numbers, Signal

AT_REST = 1e-9  # size of X_N, relative to the largest X_j, that counts as zero


@dataclass(frozen=True)
class FiniteResponse:
    """Responses X_0..X_N and U_0..U_{N-1} of a model to its disturbances.

    Attributes:
        model: matrices A, B, E.
        state: X (M, n, q), M = N + 1, the last one zero.
        control: U (N, p, q).
    """

    model: DisturbedModel
    state: Float[np.ndarray, "M n q"]
    control: Float[np.ndarray, "N p q"]

    @property
    def length(self) -> int:
        """Number of samples N."""
        return len(self.control)

    def growth(self, state: Numbers, control: Numbers) -> Float[np.ndarray, "*rows M"]:
        """Growth of the peak of c x + d u over the samples: h_j = sum_{i<j} |c X_i + d U_i|_1.

        Args:
            state: c (..., n).
            control: d (..., p).
        """
        c, d = np.asarray(state, float), np.asarray(control, float)
        response = np.einsum("...n,jnq->...jq", c, self.state[:-1])
        response = response + np.einsum("...p,jpq->...jq", d, self.control)
        sizes = np.abs(response).sum(axis=-1)
        start = np.zeros((*sizes.shape[:-1], 1))
        return np.concatenate([start, np.cumsum(sizes, axis=-1)], axis=-1)

    def peak(self, signal: Signal) -> float:
        """Largest value of a signal under all disturbances of the box."""
        return float(self.growth(signal.state, signal.control)[-1])

    def attack(self, signal: Signal) -> Float[np.ndarray, "N q"]:
        """Disturbances w(0)..w(N-1) that drive the signal to its peak at sample N."""
        response = np.einsum("n,jnq->jq", signal.state, self.state[:-1])
        response = response + np.einsum("p,jpq->jq", signal.control, self.control)
        return np.sign(response)[::-1]


def brought_to_rest(
    model: DisturbedModel, controls: np.ndarray, vanishing: np.ndarray
) -> FiniteResponse:
    """Response of these controls, changed by as little as brings the state to rest to rounding."""
    N, p, q = controls.shape
    n = model.states
    C = vanishing
    # what U_j does to (X_N, sum C X_j): from the last sample backwards
    after, sums = np.eye(n), np.zeros((len(C), n))
    maps = np.zeros((N, n + len(C), p))
    for j in range(N - 1, -1, -1):
        maps[j] = np.concatenate([after @ model.B, sums @ model.B])
        after, sums = after @ model.A, C + sums @ model.A
    wide = maps.transpose(1, 0, 2).reshape(n + len(C), N * p)
    for _ in range(2):  # the second one takes away the rounding of the first
        states = _states(model, controls)
        missed = np.concatenate([states[-1], np.einsum("mn,jnq->mq", C, states[:-1])])
        change = np.linalg.lstsq(wide, -missed, rcond=None)[0]
        controls = controls + change.reshape(N, p, q)
    states = _states(model, controls)
    size = np.abs(states).max(axis=(0, 2))
    if (np.abs(states[-1]).max(axis=1) > AT_REST * size).any():
        raise ValueError(f"length: a response of {N} samples cannot be brought to rest to rounding")
    states[-1] = 0.0
    return FiniteResponse(model, states, controls)


def _states(model: DisturbedModel, controls: np.ndarray) -> np.ndarray:
    states = [model.E]
    for control in controls:
        states.append(model.A @ states[-1] + model.B @ control)
    return np.stack(states)
