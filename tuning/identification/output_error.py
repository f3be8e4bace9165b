"""Output-error fits: parameters under which a simulation comes nearest to several records.

A simulation starts from recorded inputs only and never corrects itself by the recorded output, so
that noise in the output is not mistaken for dynamics. Parameters are shared by all records, but for
a few that every record has of its own: where it starts, what it is offset by.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from tuning.identification.estimates import coloured_covariance

Residual = Callable[
    ..., Float[Array, " T"]
]  # (shared (n,), own (m,), *signals) -> simulated minus recorded; traceable


class OutputError(NamedTuple):
    """The fit.

    Attributes:
        shared: parameters of all records (n,).
        residuals: of every record (T,), which may differ in length.
        slopes: of the residuals to the shared parameters, then to the own ones of every record (T,
            n + R m).
        converged: whether the search ended by itself.
    """

    shared: Float[np.ndarray, " n"]
    residuals: list[Float[np.ndarray, " _"]]
    slopes: list[Float[np.ndarray, "_ s"]]
    converged: bool

    def covariance(
        self, correlations: Sequence[Float[np.ndarray, " _"]]
    ) -> Float[np.ndarray, "n n"]:
        """Covariance of the shared parameters, for these autocorrelations of every record."""
        n = len(self.shared)
        return coloured_covariance(self.slopes, correlations)[:n, :n]


def output_error(
    residual: Residual,
    signals: Sequence[tuple[Any, ...]],
    shared: Float[np.ndarray, " n"],
    own: Float[np.ndarray, "R m"],
) -> OutputError:
    """Fit from a start.

    `signals` holds the arguments of `residual` beside the parameters, for every record.
    """
    n, m = len(shared), own.shape[1]

    def parts(theta):
        return [(theta[:n], theta[n + m * k : n + m * (k + 1)]) for k in range(len(signals))]

    def residuals(theta):
        return [
            np.asarray(_value(residual, *part, one))
            for part, one in zip(parts(theta), signals, strict=True)
        ]

    def slopes(theta):
        found = []
        for k, (part, one) in enumerate(zip(parts(theta), signals, strict=True)):
            to_shared, to_own = _slopes(residual, *part, one)
            rows = np.zeros((len(to_own), len(theta)))
            rows[:, :n], rows[:, n + m * k : n + m * (k + 1)] = to_shared, to_own
            found.append(rows)
        return found

    def remainder(theta):
        return np.concatenate(residuals(theta))

    def jacobian(theta):
        return np.concatenate(slopes(theta))

    start = np.append(shared, own)
    # a step to parameters that diverge has an infinite sum of squares, and is taken back
    with np.errstate(over="ignore"):
        found = least_squares(remainder, start, jacobian, x_scale="jac")  # pyright: ignore[reportArgumentType]
    return OutputError(found.x[:n], residuals(found.x), slopes(found.x), bool(found.success))


@partial(jax.jit, static_argnums=0)
def _value(residual, shared, own, signals):
    return residual(shared, own, *signals)


@partial(jax.jit, static_argnums=0)
def _slopes(residual, shared, own, signals):
    return jax.jacfwd(residual, argnums=(0, 1))(shared, own, *signals)
