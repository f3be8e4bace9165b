"""Linear plants from linear plants: discretisation, input delay, input gains."""

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant


def zoh(A, B, dt: float) -> tuple[Float[Array, "n n"], Float[Array, "n p"]]:
    """Exact zero-order-hold discretisation of dx/dt = A x + B u: the blocks of expm([[A, B], [0, 0]] dt)."""
    A, B = jnp.asarray(A), jnp.asarray(B)
    n, p = B.shape
    block = jnp.zeros((n + p, n + p), A.dtype).at[:n, :n].set(A).at[:n, n:].set(B)
    discrete = jsl.expm(block * dt)
    return discrete[:n, :n], discrete[:n, n:]


def with_input_delay(plant: LinearPlant, samples: int) -> LinearPlant:
    """Model of a plant whose control acts `samples` late: the state gains the line (u(k-1), ..., u(k-samples)).

    Raises:
        ValueError: `samples` is negative.
    """
    if samples < 0:
        raise ValueError(f"samples: a delay cannot be negative, received {samples}")
    if samples == 0:
        return plant
    n, p, line = plant.states, plant.inputs, samples * plant.inputs
    A = (
        jnp.zeros((n + line, n + line), plant.A.dtype)
        .at[:n, :n]
        .set(plant.A)
        .at[:n, n + line - p :]
        .set(plant.B)
    )
    A = A.at[n + p :, n : n + line - p].set(jnp.eye(line - p))
    B = jnp.zeros((n + line, p), plant.A.dtype).at[n : n + p].set(jnp.eye(p))
    C = jnp.concatenate([plant.C, jnp.zeros((plant.axes, line), plant.A.dtype)], axis=1)
    return LinearPlant(A, B, C, plant.dt)


def with_input_gains(plant: LinearPlant, gains) -> LinearPlant:
    """The plant with input i scaled by `gains` (p,): B diag(gains)."""
    gains = jnp.broadcast_to(jnp.asarray(gains, plant.B.dtype), (plant.inputs,))
    return eqx.tree_at(lambda p: p.B, plant, plant.B * gains)
