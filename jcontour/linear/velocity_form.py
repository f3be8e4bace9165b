"""Velocity form of a plant: offset-free control without a disturbance model.

With dx_k = x_k - x_{k-1} and du_k = u_k - u_{k-1}, and a control that acts one sample late (Lam,
eq. 6),

    [dx_{k+1}; du_k; y_{k+1}] = [[A, B, 0], [0, 0, 0], [C A, C B, I]] [dx_k; du_{k-1}; y_k]
                                + [0; I; 0] du_k
A constant force changes x, but not how dx moves on: it cancels.
"""

import jax
import jax.numpy as jnp

from jcontour.linear.plant import LinearPlant


def velocity_form(plant: LinearPlant) -> LinearPlant:
    """Velocity form of any plant: the state is [dx (n), du_{k-1} (p), y (m)], the control du_k."""
    return LinearPlant(*_matrices(plant.A, plant.B, plant.C), plant.dt)


@jax.jit
def _matrices(A, B, C):
    (n, p), m, dtype = B.shape, C.shape[0], A.dtype
    N = n + p + m
    controls, outputs = slice(n, n + p), slice(n + p, N)
    A_v = jnp.zeros((N, N), dtype)
    A_v = A_v.at[:n, :n].set(A)
    A_v = A_v.at[:n, controls].set(B)
    A_v = A_v.at[outputs, :n].set(C @ A)
    A_v = A_v.at[outputs, controls].set(C @ B)
    A_v = A_v.at[outputs, outputs].set(jnp.eye(m, dtype=dtype))
    B_v = jnp.zeros((N, p), dtype).at[controls].set(jnp.eye(p, dtype=dtype))
    C_v = jnp.zeros((m, N), dtype).at[:, outputs].set(jnp.eye(m, dtype=dtype))
    return A_v, B_v, C_v
