"""Discrete H-infinity synthesis by two Riccati equations.

    x+ = A x + B1 w + B2 u,   z = C1 x + D11 w + D12 u,   y = C2 x + D21 w
The control u = K(y), with y of now, keeps the norm from w to z below gamma. The first equation
completes the square of |z|^2 - gamma^2 |w|^2:

    |T'(u - u*)|^2 - |N'(w - w*)|^2,   w* = F x
The second one estimates u* from y while r = N'(w - w*) disturbs, at the level one (Green &
Limebeer, Linear Robust Control, 1995, appendix B). Derivatives pass both.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from jcontour.linear.plant import spectral_radius
from jcontour.riccati.algebraic import DOUBLINGS

MOST, CLOSE = 100.0, 1e-7  # largest gamma that is looked for, and how close the least is found
# of a zero eigenvalue: what rounding leaves of it, over the largest, and where all are small
ROUNDED, SMALL = 1e-9, 1e-12


class Generalised(NamedTuple):
    """Plant from disturbances w and controls u to performance z and measurements y."""

    A: Float[Array, "n n"]
    B1: Float[Array, "n w"]
    B2: Float[Array, "n u"]
    C1: Float[Array, "z n"]
    D11: Float[Array, "z w"]
    D12: Float[Array, "z u"]
    C2: Float[Array, "y n"]
    D21: Float[Array, "y w"]


class Central(NamedTuple):
    """Central controller in observer form, with the innovation e = y - C x.

    u = F x + D e,   x+ = A x + B u + L e
    """

    A: Float[Array, "n n"]
    B: Float[Array, "n u"]
    C: Float[Array, "y n"]
    F: Float[Array, "u n"]
    D: Float[Array, "u y"]
    L: Float[Array, "n y"]


class Conditions(NamedTuple):
    """What decides whether a level is met: both solutions, their loops and their pivots."""

    solutions: tuple[Float[Array, "n n"], Float[Array, "n n"]]
    loops: tuple[Float[Array, "n n"], Float[Array, "n n"]]
    positive: tuple[Float[Array, "u u"], Float[Array, "w w"], Float[Array, "y y"], Array]

    def met(self) -> bool:
        """Whether the norm of the closed loop is below the level."""
        numbers = jax.tree.map(np.asarray, self)
        if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(numbers)):
            return False
        values = [np.linalg.eigvalsh(one) for one in numbers.solutions]
        return (
            all(one[0] >= -ROUNDED * one[-1] - SMALL for one in values)
            and all(np.linalg.eigvalsh(one)[0] > 0 for one in numbers.positive)
            and all(float(spectral_radius(one)) < 1 for one in numbers.loops)
        )


def _stationary(A, B, Q, S, R):
    """Stabilising X of x'Q x + 2 x'S v + v'R v, its pivot M and the row L of v = -M^-1 L x."""
    X = _stabilising(A, B, Q, S, R)
    return X, R + B.T @ X @ B, S.T + B.T @ X @ A


@jax.custom_jvp
def _stabilising(A, B, Q, S, R) -> Float[Array, "n n"]:
    """SciPy's solution: doubling breaks down at levels between, where R is indefinite."""
    return jax.pure_callback(_solved, A, A, B, Q, S, R, vmap_method="sequential")


def _solved(*matrices) -> np.ndarray:
    A, B, Q, S, R = (np.asarray(matrix) for matrix in matrices)
    try:
        return scipy.linalg.solve_discrete_are(A, B, Q, R, s=S)
    except (np.linalg.LinAlgError, ValueError):
        return np.full_like(A, np.nan)


@_stabilising.defjvp
def _slope(primals, tangents):
    """dX = A_c' dX A_c + the change of the stage's cost under v = -K x, which is stationary."""
    A, B, Q, S, R = primals
    dA, dB, dQ, dS, dR = tangents
    X = _stabilising(A, B, Q, S, R)
    K = jnp.linalg.solve(R + B.T @ X @ B, S.T + B.T @ X @ A)
    loop, moved = A - B @ K, dA - dB @ K
    stage = dQ - dS @ K - K.T @ dS.T + K.T @ dR @ K + moved.T @ X @ loop + loop.T @ X @ moved

    def double(carry, _):
        power, total = carry
        return (power @ power, total + power.T @ total @ power), None

    (_, dX), _ = jax.lax.scan(double, (loop, stage), length=DOUBLINGS)
    return X, dX


@jax.jit
def central_controller(plant: Generalised, gamma: Float[Array, ""]) -> tuple[Central, Conditions]:
    """Central controller of a level gamma, and what decides whether the level is met."""
    A, B1, B2, C1, D11, D12, C2, D21 = plant
    w, inputs = B1.shape[1], B2.shape[1]
    B, D = jnp.concatenate([B1, B2], axis=1), jnp.concatenate([D11, D12], axis=1)
    level = jnp.diag(jnp.concatenate([jnp.full(w, gamma**2), jnp.zeros(inputs)]))
    X, M, row = _stationary(A, B, C1.T @ C1, C1.T @ D, D.T @ D - level)
    M_uu, M_uw = M[w:, w:], M[w:, :w]
    pivot = -(M[:w, :w] - M_uw.T @ jnp.linalg.solve(M_uu, M_uw))
    worst = jnp.linalg.solve(pivot, row[:w] - M_uw.T @ jnp.linalg.solve(M_uu, row[w:]))
    T, N = jnp.linalg.cholesky(M_uu), jnp.linalg.cholesky(pivot)
    inwards = jnp.linalg.inv(N).T  # w = w* + N^-T r
    back = jnp.linalg.inv(T)
    A_t, C_t, B_t, D_t = A + B1 @ worst, C2 + D21 @ worst, B1 @ inwards, D21 @ inwards
    wanted, direct = back @ (row[w:] + M_uw @ worst), back @ M_uw @ inwards
    C, E = jnp.concatenate([wanted, C_t]), jnp.concatenate([direct, D_t])
    one = jnp.diag(jnp.concatenate([jnp.ones(inputs), jnp.zeros(C2.shape[0])]))
    Y, S, column = _stationary(A_t.T, C.T, B_t @ B_t.T, B_t @ E.T, E @ E.T - one)
    S_yy, S_uy = S[inputs:, inputs:], S[:inputs, inputs:]
    at_y = jnp.linalg.inv(S_yy)
    missed = S_uy @ at_y @ S_uy.T - S[:inputs, :inputs]
    law = Central(A_t, B2, C_t, -back.T @ wanted, -back.T @ S_uy @ at_y, column[inputs:].T @ at_y)
    loops = A - B @ jnp.linalg.solve(M, row), A_t - column.T @ jnp.linalg.solve(S, C)
    return law, Conditions((X, Y), loops, (M_uu, pivot, S_yy, missed))


def least_gamma(plant: Generalised, most: float = MOST) -> float:
    """Least level that a controller meets, by bisection: at most 1e-7 of it too large.

    Raises:
        ValueError: no level below `most` is met.
    """
    synthesis = partial(central_controller, plant)

    def meets(level):
        return synthesis(jnp.asarray(float(level)))[1].met()

    if not meets(most):
        raise ValueError(
            f"weights: no controller meets them at a level below {most:g}; ask for less bandwidth, "
            "a larger peak or more effort, and see that every mode is reached and seen"
        )
    low, high = np.log(1e-6), np.log(most)
    while high - low > CLOSE:
        middle = (low + high) / 2
        low, high = (low, middle) if meets(np.exp(middle)) else (middle, high)
    return float(np.exp(high))
