"""A machine told in changes: offset-free without a disturbance model of its own.

With dx_k = x_k - x_{k-1} and du_k = u_k - u_{k-1}, and a control that acts one sample late,
    [dx_{k+1}; du_k; y_{k+1}] = [[A, B, 0], [0, 0, 0], [C A, C B, I]] [dx_k; du_{k-1}; y_k] + [0; I;
    0] du_k     (Lam, eq. 6)
A constant force changes x but not the law of dx, so that it cancels.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant


def velocity_form(plant: LinearPlant) -> LinearPlant:
    """Eq. 6 of any plant: the state is [dx (n), du_{k-1} (p), y (m)], the control du_k."""
    n, p, m = plant.states, plant.inputs, plant.axes
    N = n + p + m
    A = jnp.zeros((N, N), plant.A.dtype).at[:n, :n].set(plant.A).at[:n, n : n + p].set(plant.B)
    A = (
        A.at[n + p :, :n]
        .set(plant.C @ plant.A)
        .at[n + p :, n : n + p]
        .set(plant.C @ plant.B)
        .at[n + p :, n + p :]
        .set(jnp.eye(m))
    )
    B = jnp.zeros((N, p), plant.A.dtype).at[n : n + p].set(jnp.eye(p))
    C = jnp.zeros((m, N), plant.A.dtype).at[:, n + p :].set(jnp.eye(m))
    return LinearPlant(A, B, C, plant.dt)


def velocity_state(
    state: Float[Array, " n"],
    before: Float[Array, " n"],
    control_change: Float[Array, " p"],
    output: Float[Array, " m"],
) -> Float[Array, " n+p+m"]:
    """[x_k - x_{k-1}, u_{k-1} - u_{k-2}, y_k]."""
    return jnp.concatenate([state - before, control_change, output])
