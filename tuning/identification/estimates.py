"""Estimated parameters with their covariance, when the residuals are not white.

A least-squares fit of r(theta) with Jacobian J has, to first order, theta - truth = -(J'J)^-1 J'e.
Encoder counts, filters and what a model lacks make e coloured, and the usual s^2 (J'J)^-1 then
promises too much. Here

    cov = (J'J)^-1  [sum_kl J_k' c(k - l) J_l]  (J'J)^-1

with c the autocorrelation of the residuals (Klein & Morelli, Aircraft System Identification, 2006,
section 5.3): a model of it where its causes are known, otherwise that of the residuals themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.signal import fftconvolve
from scipy.stats import norm

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Estimate:
    """Values with names and covariance."""

    names: tuple[str, ...]  # (n,)
    values: Float[np.ndarray, " n"]  # (n,)
    covariance: Float[np.ndarray, "n n"]  # (n, n)

    def __getitem__(self, name: str) -> float:
        """Value of a name."""
        return float(self.values[self.names.index(name)])

    def deviation(self, name: str) -> float:
        """Standard deviation; infinite where rounding has taken the variance below zero."""
        k = self.names.index(name)
        variance = float(self.covariance[k, k])
        return float(np.sqrt(variance)) if variance >= 0 else np.inf

    def interval(self, name: str) -> tuple[float, float]:
        """Ends of the 95 % confidence interval."""
        half = float(norm.ppf((1 + CONFIDENCE) / 2)) * self.deviation(name)
        return self[name] - half, self[name] + half


def coloured_covariance(
    jacobians: Sequence[Float[np.ndarray, "_ n"]], correlations: Sequence[Float[np.ndarray, " _"]]
) -> Float[np.ndarray, "n n"]:
    """Covariance of a least-squares fit to runs of rows without gaps.

    Run k has a Jacobian (T_k, n), and its residuals have the autocorrelation `correlations[k]`.
    """
    spread, information = 0.0, 0.0
    for J, one_sided in zip(jacobians, correlations, strict=True):
        c = one_sided[: len(J)]
        two_sided = np.concatenate([c[:0:-1], c])[:, None]
        spread = spread + J.T @ fftconvolve(J, two_sided, axes=0)[len(c) - 1 : len(c) - 1 + len(J)]
        information = information + J.T @ J
    inverse = scaled_inverse(np.asarray(information))
    with np.errstate(invalid="ignore"):  # infinite where nothing is seen
        return inverse @ np.asarray(spread) @ inverse


def autocorrelation(
    residuals: Sequence[Float[np.ndarray, " _"]], lags: int
) -> Float[np.ndarray, " {lags}+1"]:
    """Mean of r(k) r(k + l) for l = 0..lags, tapered to nothing over the second half of the lags.

    The flat top keeps correlations of up to half the lags unbiased (Politis & Romano, J. Time
    Series Analysis 16, 1995).
    """
    rows = sum(len(r) for r in residuals)

    def product(lag: int) -> float:
        return sum(float(r[: max(len(r) - lag, 0)] @ r[lag:]) for r in residuals)

    products = np.array([product(lag) for lag in range(lags + 1)])
    taper = np.minimum(1, 2 * (1 - np.arange(lags + 1) / (lags + 1)))
    return products / rows * taper


def scaled_inverse(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Inverse of a positive matrix whose rows may differ by many orders of magnitude.

    Directions that are not seen come out huge, or infinite.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    values = np.maximum(values, np.finfo(float).eps * len(scale))
    with np.errstate(over="ignore"):
        return (vectors / values) @ vectors.T / np.outer(scale, scale)
