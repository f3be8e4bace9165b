"""Linear plants from linear plants: discretisation, input delay, input gains."""

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant


def zoh(A, B, dt: float | Float[Array, ""]) -> tuple[Float[Array, "n n"], Float[Array, "n p"]]:
    """Exact zero-order-hold discretisation of dx/dt = A x + B u.

    The results are the upper blocks of expm([[A, B], [0, 0]] dt).

    Args:
        A: (n, n).
        B: (n, p).
        dt: sample period [s].

    A mass of 2 kg under a force, sampled every 0.1 s:

    >>> A, B = zoh([[0.0, 1.0], [0.0, 0.0]], [[0.0], [0.5]], dt=0.1)
    >>> import numpy as np
    >>> np.asarray(A).round(6).tolist()
    [[1.0, 0.1], [0.0, 1.0]]
    >>> np.asarray(B).round(6).tolist()
    [[0.0025], [0.05]]
    """
    A, B = jnp.asarray(A), jnp.asarray(B)
    n, p = B.shape
    block = jnp.zeros((n + p, n + p), A.dtype).at[:n, :n].set(A).at[:n, n:].set(B)
    discrete = jsl.expm(block * dt)
    return discrete[:n, :n], discrete[:n, n:]


def with_input_delay(plant: LinearPlant, samples: int) -> LinearPlant:
    """Model of a plant whose control acts `samples` late.

    The state gains the line (u(k-1), ..., u(k-samples)).

    Raises:
        ValueError: `samples` is negative.
    """
    if samples < 0:
        raise ValueError(f"samples: a delay cannot be negative, received {samples}")
    if samples == 0:
        return plant
    n, p, line = plant.states, plant.inputs, samples * plant.inputs
    dtype = plant.A.dtype
    A = jnp.zeros((n + line, n + line), dtype)
    A = A.at[:n, :n].set(plant.A)
    A = A.at[:n, n + line - p :].set(plant.B)
    A = A.at[n + p :, n : n + line - p].set(jnp.eye(line - p, dtype=dtype))
    B = jnp.zeros((n + line, p), dtype).at[n : n + p].set(jnp.eye(p, dtype=dtype))
    C = jnp.concatenate([plant.C, jnp.zeros((plant.axes, line), dtype)], axis=1)
    return LinearPlant(A, B, C, plant.dt)


def with_input_gains(plant: LinearPlant, gains) -> LinearPlant:
    """Plant whose input i is scaled by `gains` (p,): B diag(gains)."""
    gains = jnp.broadcast_to(jnp.asarray(gains, plant.B.dtype), (plant.inputs,))
    return eqx.tree_at(lambda p: p.B, plant, plant.B * gains[None])
