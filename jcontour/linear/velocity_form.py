"""Velocity form of a plant: offset-free control without a disturbance model.

With dx_k = x_k - x_{k-1} and du_k = u_k - u_{k-1}, and a control that acts one sample late (Lam,
eq. 6),
    [dx_{k+1}; du_k; y_{k+1}] = [[A, B, 0], [0, 0, 0], [C A, C B, I]] [dx_k; du_{k-1}; y_k]
                                + [0; I; 0] du_k
A constant force changes x, but not how dx moves on: it cancels.
"""

import jax.numpy as jnp

from jcontour.linear.plant import LinearPlant


def velocity_form(plant: LinearPlant) -> LinearPlant:
    """Velocity form of any plant: the state is [dx (n), du_{k-1} (p), y (m)], the control du_k."""
    n, p, m = plant.states, plant.inputs, plant.axes
    N, dtype = n + p + m, plant.A.dtype
    controls, outputs = slice(n, n + p), slice(n + p, N)
    A = jnp.zeros((N, N), dtype)
    A = A.at[:n, :n].set(plant.A)
    A = A.at[:n, controls].set(plant.B)
    A = A.at[outputs, :n].set(plant.C @ plant.A)
    A = A.at[outputs, controls].set(plant.C @ plant.B)
    A = A.at[outputs, outputs].set(jnp.eye(m, dtype=dtype))
    B = jnp.zeros((N, p), dtype).at[controls].set(jnp.eye(p, dtype=dtype))
    C = jnp.zeros((m, N), dtype).at[:, outputs].set(jnp.eye(m, dtype=dtype))
    return LinearPlant(A, B, C, plant.dt)
