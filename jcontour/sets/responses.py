"""Linear models under disturbances in a box, finite responses to them, and the peaks of signals.

    x(k+1) = A x(k) + B u(k) + E w(k),   |w_i(k)| <= 1
The columns of E hold the sizes of the disturbances. A reference that is not known ahead is one more
disturbance, with the largest change of its own; a previewed reference is none.

A policy that answers every disturbance w(k) with X_j w(k) in the state and U_j w(k) in the control,
j samples later, makes

    X_0 = E,   X_{j+1} = A X_j + B U_j,   X_N = 0.
The largest value of a signal c x + d u under |w_i| <= 1 is its peak, the l1 norm of its response:

    sum_{j<N} |c X_j + d U_j|_1.
On a model that changes from sample to sample,

    x(k+1) = A_k x(k) + B_k u(k) + E_k w(k),   |w_i(k)| <= 1
    X_k0 = E_k,   X_k(j+1) = A_(k+1+j) X_kj + B_(k+1+j) U_kj,   X_kN = 0.
A machine whose model switches along its path is of this form: an answer that begins before a switch
ends after it. No set is handed over to another, which Yuan's Algorithm 3 and (5.43) leave open. The
models have to be known ahead, as those along a known path are.

At sample t a plan that was made j samples before has lost

    h_tj = sum_{i=1..j} |c_t X_(t-i)(i-1) + d_t U_(t-i)(i-1)|_1
of the slack of a signal c_t x + d_t u; h_tN is its peak.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float, Int

Numbers = ArrayLike | Sequence[Any]  # an array, or lists that make one


class Signal(NamedTuple):
    """A signal c x + d u, and its bound.

    Attributes:
        name: for people.
        state: c (n,).
        control: d (p,).
        limit: largest magnitude that is allowed; infinite where there is none.
    """

    name: str
    state: Float[np.ndarray, " n"]
    control: Float[np.ndarray, " p"]
    limit: float = np.inf


class DisturbedModel(NamedTuple):
    """Matrices A (n, n), B (n, p) and E (n, q) of the model."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n p"]
    E: Float[np.ndarray, "n q"]

    @classmethod
    def of(cls, A: Numbers, B: Numbers, E: Numbers) -> "DisturbedModel":
        """Model of arrays; a vector is one column.

        Raises:
            ValueError: shapes do not fit or a number is not finite.
        """
        matrices = [np.asarray(matrix, float) for matrix in (A, B, E)]
        columns = [one[:, None] if one.ndim == 1 else one for one in matrices[1:]]
        return cls(*_checked(matrices[0], *columns))

    @property
    def states(self) -> int:
        """Number of states n."""
        return self.A.shape[0]

    @property
    def inputs(self) -> int:
        """Number of controls p."""
        return self.B.shape[1]

    @property
    def disturbances(self) -> int:
        """Number of disturbances q."""
        return self.E.shape[1]

    def with_disturbance(self, E: Numbers) -> "DisturbedModel":
        """The model with more disturbances: the columns of `E` beside its own."""
        more = np.asarray(E, float)
        columns = more[:, None] if more.ndim == 1 else more
        return DisturbedModel.of(self.A, self.B, np.concatenate([self.E, columns], axis=1))

    def state_signals(
        self, names: Sequence[str], rows: Numbers, limits: Numbers = np.inf
    ) -> tuple[Signal, ...]:
        """Signals c x from rows (r, n), with one limit or one for each."""
        coefficients = np.atleast_2d(np.asarray(rows, float))
        bounds = np.broadcast_to(np.asarray(limits, float), (len(coefficients),))
        still = np.zeros(self.inputs)
        return tuple(map(Signal, names, coefficients, [still] * len(coefficients), bounds.tolist()))

    def control_signals(
        self, limits: Numbers = np.inf, name: str = "control"
    ) -> tuple[Signal, ...]:
        """Every control as a signal, with one limit or one for each."""
        p = self.inputs
        bounds = np.broadcast_to(np.asarray(limits, float), (p,))
        names = [name] if p == 1 else [f"{name} {i + 1}" for i in range(p)]
        still = np.zeros(self.states)
        return tuple(map(Signal, names, [still] * p, np.eye(p), bounds.tolist()))


def _checked(A: np.ndarray, B: np.ndarray, E: np.ndarray) -> tuple[np.ndarray, ...]:
    if A.ndim != 2 or A.shape[0] != A.shape[1] or A.shape[0] == 0:
        raise ValueError(f"A: needs to be square (n, n), received {A.shape}")
    n = len(A)
    for name, matrix, columns in (("B", B, "p"), ("E", E, "q")):
        if matrix.ndim != 2 or matrix.shape[0] != n or matrix.shape[1] == 0:
            raise ValueError(f"{name}: needs shape ({n}, {columns}), received {matrix.shape}")
    for name, matrix in (("A", A), ("B", B), ("E", E)):
        if not np.isfinite(matrix).all():
            raise ValueError(f"{name}: every entry needs to be finite, received NaN or inf")
    return A, B, E


AT_REST = 1e-9  # size of X_N, relative to the largest X_j, that counts as zero


@dataclass(frozen=True)
class FiniteResponse:
    """Responses X_0..X_N and U_0..U_{N-1} of a model to its disturbances."""

    model: DisturbedModel  # matrices A, B, E
    state: Float[np.ndarray, "M n q"]  # X (M, n, q), M = N + 1, the last one zero
    control: Float[np.ndarray, "N p q"]  # U (N, p, q)

    @property
    def length(self) -> int:
        """Number of samples N."""
        return len(self.control)

    def peak(self, signal: Signal) -> float:
        """Largest value of a signal under all disturbances of the box."""
        return float(np.abs(self._of(signal)).sum())

    def attack(self, signal: Signal) -> Float[np.ndarray, "N q"]:
        """Disturbances w(0)..w(N-1) that drive the signal to its peak at sample N."""
        return np.sign(self._of(signal))[::-1]

    def _of(self, signal: Signal) -> Float[np.ndarray, "N q"]:
        response = np.einsum("n,jnq->jq", signal.state, self.state[:-1])
        return response + np.einsum("p,jpq->jq", signal.control, self.control)


def brought_to_rest(model: DisturbedModel, controls: np.ndarray) -> FiniteResponse:
    """Response of these controls, changed by as little as brings the state to rest to rounding.

    Raises:
        ValueError: no controls (N, p, q) bring the state to rest.
    """
    samples = len(controls) + 1
    along = VaryingModel(*(np.broadcast_to(one, (samples, *one.shape)) for one in model))
    states, controls = _rested(along, controls[None])
    return FiniteResponse(model, states[0], controls[0])


class VaryingModel(NamedTuple):
    """Matrices A (S, n, n), B (S, n, p) and E (S, n, q) of S samples."""

    A: Float[np.ndarray, "S n n"]
    B: Float[np.ndarray, "S n p"]
    E: Float[np.ndarray, "S n q"]

    def with_input_delay(self) -> "VaryingModel":
        """The model whose control acts one sample later; the waiting one is a state, after x."""
        S, n, p = self.B.shape
        A = np.concatenate([self.A, self.B], axis=2)
        A = np.concatenate([A, np.zeros((S, p, n + p))], axis=1)
        B = np.concatenate([np.zeros((S, n, p)), np.broadcast_to(np.eye(p), (S, p, p))], axis=1)
        E = np.concatenate([self.E, np.zeros((S, p, self.E.shape[2]))], axis=1)
        return VaryingModel(A, B, E)


@dataclass(frozen=True)
class VaryingResponse:
    """Responses to the disturbances of samples 0..R-1, R = S - N."""

    model: VaryingModel  # of S samples
    state: Float[np.ndarray, "R M n q"]  # X (R, M, n, q), M = N + 1, the last one of each zero
    control: Float[np.ndarray, "R N p q"]  # U (R, N, p, q)

    @property
    def length(self) -> int:
        """Number of samples N."""
        return self.control.shape[1]

    @property
    def samples(self) -> int:
        """Number of samples R."""
        return len(self.control)

    def growth(self, state: Numbers, control: Numbers) -> Float[np.ndarray, "R r M"]:
        """Loss of slack h_tj of signals c_t x + d_t u, for plans that are j = 0..N samples old.

        Before sample 0 nothing acted.

        Args:
            state: c (R, r, n).
            control: d (R, r, p).
        """
        c, d = np.asarray(state, float), np.asarray(control, float)
        sizes = np.zeros((*c.shape[:2], self.length + 1))
        for i in range(1, self.length + 1):
            answers = c[i:] @ self.state[:-i, i - 1] + d[i:] @ self.control[:-i, i - 1]
            sizes[i:, :, i] = np.abs(answers).sum(axis=-1)
        return np.cumsum(sizes, axis=-1)

    def attack(self, state: Numbers, sample: int) -> Float[np.ndarray, "N q"]:
        """Disturbances w(t-N)..w(t-1) that drive c x to its peak at a sample t >= N.

        Args:
            state: c (n,).
            sample: t.
        """
        c, N = np.asarray(state, float), self.length
        rows = [c @ self.state[sample - i, i - 1] for i in range(N, 0, -1)]
        return np.sign(np.stack(rows))


def brought_to_rest_along(
    model: VaryingModel, patterns: Sequence[FiniteResponse], which: Int[np.ndarray, " S"]
) -> VaryingResponse:
    """Responses that come to rest on the model of every sample.

    The controls are those of a pattern, changed by as little as brings the state to rest: the
    pattern is made for a model that is near, its sizes E may be others.

    Args:
        model: of S samples.
        patterns: responses of N samples, all of one shape.
        which: pattern of the disturbance of every sample (S,).

    Raises:
        ValueError: there are no more samples than N, or no controls bring the state to rest.
    """
    controls = np.stack([one.control for one in patterns])
    R = len(model.A) - controls.shape[1]
    if R < 1:
        raise ValueError(
            f"model: needs more than {controls.shape[1]} samples, received {len(model.A)}"
        )
    return VaryingResponse(model, *_rested(model, controls[np.asarray(which)[:R]]))


def _rested(
    model: VaryingModel, U: Float[np.ndarray, "R N p q"]
) -> tuple[Float[np.ndarray, "R M n q"], Float[np.ndarray, "R N p q"]]:
    """States X and controls U, these changed by as little as makes X_N zero to rounding."""
    (R, N, p), n = U.shape[:3], model.A.shape[1]
    after, reach = np.broadcast_to(np.eye(n), (R, n, n)), np.zeros((R, n, N, p))
    for j in range(N - 1, -1, -1):  # from the last sample backwards
        A, B = model.A[1 + j : 1 + j + R], model.B[1 + j : 1 + j + R]
        reach[:, :, j], after = after @ B, after @ A
    wide = reach.reshape(R, n, N * p)
    units = np.abs(wide).max(axis=2, keepdims=True)
    units = np.where(units > 0, units, 1.0)
    back = np.linalg.pinv(wide / units)
    for _ in range(2):  # the second one takes away the rounding of the first
        missed = _states(model, U)[:, -1] / units
        U = U - (back @ missed).reshape(U.shape)
    X = _states(model, U)
    if (np.abs(X[:, -1]).max(axis=(0, 2)) > AT_REST * np.abs(X).max(axis=(0, 1, 3))).any():
        raise ValueError(f"length: responses of {N} samples cannot be brought to rest")
    X[:, -1] = 0.0
    return X, U


def _states(model: VaryingModel, U: Float[np.ndarray, "R N p q"]) -> Float[np.ndarray, "R M n q"]:
    R = len(U)
    states = [model.E[:R]]
    for j in range(U.shape[1]):
        A, B = model.A[1 + j : 1 + j + R], model.B[1 + j : 1 + j + R]
        states.append(A @ states[-1] + B @ U[:, j])
    return np.stack(states, axis=1)
