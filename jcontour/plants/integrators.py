"""Integration of a machine's equation of motion over one step of time."""

from collections.abc import Callable
from typing import TypeVar

import jax
from jaxtyping import Array, Float

State = TypeVar("State")  # any pytree of arrays


def runge_kutta(rates: Callable[[State], State], x: State, h: float | Float[Array, ""]) -> State:
    """State after one classical Runge-Kutta step of fourth order over h seconds.

    Args:
        rates: any function from a state to its time derivative.
        x: the state, any pytree.
        h: step [s].
    """

    def ahead(slope: State, share: float) -> State:
        return jax.tree.map(lambda a, b: a + share * h * b, x, slope)

    k1 = rates(x)
    k2 = rates(ahead(k1, 0.5))
    k3 = rates(ahead(k2, 0.5))
    k4 = rates(ahead(k3, 1.0))
    return jax.tree.map(
        lambda a, p, q, r, s: a + h / 6 * (p + 2 * q + 2 * r + s), x, k1, k2, k3, k4
    )
