"""Supports of the smallest robust invariant set of a stable loop, with a bounded remainder.

    x(k+1) = M x(k) + E w(k),   |w_i| <= 1
All that the disturbances can do to the state is the set sum_j M^j E W, the smallest invariant set
(Kolmanovsky & Gilbert 1998). Its support in the direction c, the largest c x, is the series

    sum_j |c M^j E|_1.
With M' P M <= g^2 P the terms from N on add at most |c|_{P^-1} sum_i |M^N E_i|_P / (1 - g).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_lyapunov

from jcontour.linear.plant import ROUNDING, spectral_radius
from jcontour.sets.disturbed_model import Numbers

CONTRACTIONS = 5  # values of g between the spectral radius and one: the least remainder counts
MOST_TERMS = 200_000  # a loop with a spectral radius of 0.9999 needs 1.4e5 for six digits
EVERY = 8  # terms between two looks at the remainder


class Supports(NamedTuple):
    """Supports and how well they are known.

    Attributes:
        value: sum of the first terms (r,): the support is at least this.
        remainder: what all other terms add at most (r,).
        terms: how many were summed.
    """

    value: Float[np.ndarray, " r"]
    remainder: Float[np.ndarray, " r"]
    terms: int

    @property
    def bound(self) -> Float[np.ndarray, " r"]:
        """Support, from above."""
        return self.value + self.remainder


def minimal_supports(
    M: Numbers, E: Numbers, directions: Numbers, precision: float = 1e-9
) -> Supports:
    """Largest values of c x under all disturbances, for every direction c.

    A lag with a time constant of two samples, driven by |w| <= 1: 1 / (1 - 0.5).

    >>> found = minimal_supports([[0.5]], [1.0], [[1.0]], precision=1e-6)
    >>> f"{found.value[0]:.5f}", found.terms
    ('2.00000', 24)

    Args:
        M: of the closed loop (n, n).
        E: sizes of the disturbances (n, q).
        directions: c (r, n).
        precision: remainder allowed, relative to the support.

    Raises:
        ValueError: the loop is not stable, shapes do not fit, the precision is not above zero, or
            it takes more than 200000 terms.
    """
    loop, rows = np.asarray(M, float), np.atleast_2d(np.asarray(directions, float))
    sizes = np.asarray(E, float)
    response = sizes[:, None] if sizes.ndim == 1 else sizes
    _check(loop, response, rows, precision)
    radius = float(spectral_radius(loop))
    bounds = _contractions(loop, rows, radius)
    value, terms = np.zeros(len(rows)), 0
    while terms < MOST_TERMS and radius**MOST_TERMS < precision:
        for _ in range(EVERY):
            value = value + np.abs(rows @ response).sum(axis=1)
            response = loop @ response
        terms += EVERY
        remainder = _remainder(bounds, response)
        if (remainder <= precision * value).all():
            return Supports(value, remainder, terms)
    raise ValueError(
        f"precision: {precision:g} takes more than {MOST_TERMS} terms, "
        f"the spectral radius is {radius:.9g}"
    )


def _contractions(loop: np.ndarray, rows: np.ndarray, radius: float) -> list[tuple]:
    """Root of P, |c|_{P^-1} / (1 - g) of every direction, for several g."""
    found = []
    for share in np.arange(1, CONTRACTIONS + 1) / (CONTRACTIONS + 1):
        g = radius + share * (1 - radius)
        P = solve_discrete_lyapunov((loop / g).T, np.eye(len(loop)))
        lower = np.linalg.cholesky((P + P.T) / 2)
        lengths = np.linalg.norm(np.linalg.solve(lower, rows.T), axis=0)
        found.append((lower.T, lengths / (1 - g)))
    return found


def _remainder(bounds: list[tuple], response: np.ndarray) -> np.ndarray:
    sizes = [root @ response for root, _ in bounds]
    sums = [np.linalg.norm(size, axis=0).sum() for size in sizes]
    return np.min([lengths * one for (_, lengths), one in zip(bounds, sums, strict=True)], axis=0)


def _check(loop: np.ndarray, response: np.ndarray, rows: np.ndarray, precision: float) -> None:
    n = len(loop)
    if loop.shape != (n, n) or response.shape[:1] != (n,) or rows.shape[1:] != (n,):
        shapes = f"{loop.shape}, {response.shape} and {rows.shape}"
        raise ValueError(
            f"M, E, directions: need shapes (n, n), (n, q) and (r, n), received {shapes}"
        )
    if not precision > 0:
        raise ValueError(f"precision: needs to be above zero, received {precision}")
    radius = float(spectral_radius(loop))
    if not radius < 1 - ROUNDING:
        raise ValueError(
            f"M: the loop is not stable, its spectral radius is {radius:.6g}: no bound is finite"
        )
