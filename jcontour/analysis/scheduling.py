"""Gain scheduling: a loop that is stable wherever it is frozen, and how fast it may move.

Shamma & Athans (1990); of Shahruz & Behtash in the volume of 1990 there is no text here. Let
x' = A(p) x be stable for every frozen p, with A' P + P A = -I. Along a moving p

    d/dt x' P x = -|x|^2 + p' x' (dP/dp) x,
so the loop is stable while |p'| |dP/dp| < 1. Frozen stability alone is not enough: `turning` has
the same two stable eigenvalues at every instant, and grows.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import solve_continuous_lyapunov


def admissible_rate(
    matrix: Callable[[Array], Any], parameters: Sequence[float] | Float[np.ndarray, "_"]
) -> float:
    """Estimate of the largest rate |p'| at which the loop is stable [parameter per second].

        1 / max over p of |dP/dp|,   A' dP + dP A = -(dA' P + P dA)

    The maximum is that over the parameters given: one over the whole interval would be a bound.

    A mass on a spring whose damping is scheduled:

    >>> def damped(p):
    ...     return jnp.array([[0.0, 1.0], [-1.0, -1.0]]) - p * jnp.array([[0.0, 0.0], [0.0, 1.0]])
    >>> round(admissible_rate(damped, np.linspace(0.0, 1.0, 11)), 3)
    1.0

    Args:
        matrix: A (n, n) at a parameter, traceable.
        parameters: grid on which the maximum is taken; a finer one can only lower the estimate.

    Raises:
        ValueError: there is no parameter, or the frozen loop is not stable at one.
    """
    if len(parameters) == 0:
        raise ValueError("parameters: need at least one")
    sizes = [_slope(matrix, float(p)) for p in parameters]
    largest = max(sizes)
    return np.inf if largest == 0 else 1 / largest


def _slope(matrix: Callable[[Array], Any], parameter: float) -> float:
    """Norm |dP/dp| at a parameter."""
    at = jnp.asarray(parameter)
    A, dA = (np.asarray(each) for each in jax.jvp(matrix, (at,), (jnp.ones_like(at),)))
    fastest = np.max(np.linalg.eigvals(A).real)
    if not fastest < 0:
        raise ValueError(
            f"matrix: the loop frozen at {parameter:g} is not stable, "
            f"an eigenvalue has the real part {fastest:.4g}"
        )
    P = solve_continuous_lyapunov(A.T, -np.eye(len(A)))
    dP = solve_continuous_lyapunov(A.T, -(dA.T @ P + P @ dA))
    return float(np.linalg.norm(dP, 2))


def turning(angle: Float[Array, ""]) -> Float[Array, "2 2"]:
    """Matrix with the eigenvalues -1/4 +- j sqrt(7)/4 at every angle (Markus & Yamabe 1960).

        A = [[-1 + 1.5 c^2, 1 - 1.5 c s], [-1 - 1.5 c s, -1 + 1.5 s^2]],  c = cos, s = sin
    Turned at one radian per second from x = (1, 0), the state is exp(t/2) (cos t, -sin t).
    """
    c, s = jnp.cos(angle), jnp.sin(angle)
    rows = [[-1 + 1.5 * c**2, 1 - 1.5 * c * s], [-1 - 1.5 * c * s, -1 + 1.5 * s**2]]
    return jnp.stack([jnp.stack(row) for row in rows])
