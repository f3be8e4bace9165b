"""The discrete algebraic Riccati equation by structured doubling, and its gain."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour._arrays import is_concrete
from jcontour.linear.plant import spectral_radius
from jcontour.linear.small_matrices import small_inverse, small_solve

# 2^20 Riccati steps: converged to rounding for closed loops slower than any machine's
DOUBLINGS = 20


@jax.jit
def dare(
    A: Float[Array, "n n"], B: Float[Array, "n p"], Q: Float[Array, "n n"], R: Float[Array, "p p"]
) -> Float[Array, "n n"]:
    """Stabilising solution of the discrete algebraic Riccati equation by structured doubling.

        H = A' (H - H B (B' H B + R)^-1 B' H) A + Q
    McNab & Tsao, eq. 16. After i doublings the iterate is the Riccati recursion of 2^i steps from
    zero, so values and derivatives are those of the limit. Without a stabilising solution H is not
    finite, or A - B K is not stable; see `check_dare` for the message.
    """
    identity = jnp.eye(A.shape[0], dtype=A.dtype)

    def double(carry, _):
        A_k, G, H = carry
        W = small_solve(identity + G @ H, identity)
        AW = A_k @ W
        G_next = G + AW @ G @ A_k.T
        H_next = H + A_k.T @ H @ W @ A_k
        return (AW @ A_k, (G_next + G_next.T) / 2, (H_next + H_next.T) / 2), None

    start = (A, B @ small_inverse(R) @ B.T, Q)
    (_, _, H), _ = jax.lax.scan(double, start, length=DOUBLINGS)
    return H


@jax.jit
def lqr_gain(A, B, H: Float[Array, "n n"], R) -> Float[Array, "p n"]:
    """Gain of u = -K x: K = (B' H B + R)^-1 B' H A.

    McNab & Tsao, eq. 17, with the trailing A.
    """
    return small_inverse(B.T @ H @ B + R) @ B.T @ H @ A


def check_dare(A, B, Q, R) -> None:
    """Raise ValueError unless the Riccati equation has a stabilising solution.

    Traced values pass unchecked: their solution is NaN then.
    """
    if not is_concrete(A, B, Q, R):
        return
    radius = float(spectral_radius(_dare_loop(A, B, Q, R)))
    if not radius < 1:
        raise ValueError(
            "the Riccati equation has no stabilising solution: "
            f"its closed loop has spectral radius {radius:.6g} "
            "(a mode that is not stable is out of reach of the control, or costs nothing)"
        )


@jax.jit
def _dare_loop(A, B, Q, R):
    return A - B @ lqr_gain(A, B, dare(A, B, Q, R), R)
