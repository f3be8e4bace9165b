"""Linear models under disturbances in a box, and the signals that are bounded on them.

    x(k+1) = A x(k) + B u(k) + E w(k),   |w_i(k)| <= 1

The columns of E hold the sizes of the disturbances. A reference that is not known ahead is one
more disturbance, with the largest change of its own; a previewed reference is none.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

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
