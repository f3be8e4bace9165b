"""The disturbance that makes a signal as large as it can be at one sample.

    w(j) = size sign(c' M(k-1) ... M(j+1) E(j)) sign(e(k) without disturbance)
The adjoint of the signal carries its row back from sample k to the begin.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from jcontour.bounds.disturbed_loop import Box, DisturbedLoop
from jcontour.plant import Plant
from jcontour.plants.actuation import Disturbed


class Attack(NamedTuple):
    """Disturbances of every sample, inside the box; zero from the attacked sample on.

    Attributes:
        force: adds to the control.
        noise: adds to the measurement [m].
    """

    force: Float[np.ndarray, "T p"]
    noise: Float[np.ndarray, "T q"]

    def on(self, plant: Plant) -> Disturbed:
        """The plant under this attack."""
        return Disturbed(plant, force=jax.device_put(self.force), noise=jax.device_put(self.noise))


def coefficients(
    loop: DisturbedLoop, row: Float[Array | np.ndarray, " N"], sample: int
) -> Float[np.ndarray, "k d"]:
    """Effect of every disturbance before a sample on the signal row' z(sample).

        e(k) = sum_j coefficients(j)' w(j)

    Raises:
        ValueError: there is no such sample.
    """
    T = loop.E.shape[0]
    if not 0 <= sample < T:
        raise ValueError(f"sample: needs one from 0 to {T - 1}, received {sample}")
    M, E = np.asarray(loop.M), np.asarray(loop.E)
    found, adjoint = np.zeros((sample, E.shape[2])), np.asarray(row)
    for j in range(sample - 1, -1, -1):
        found[j] = adjoint @ E[j]
        adjoint = adjoint @ M[j]
    return found


def worst_attack(
    loop: DisturbedLoop, row: Float[Array | np.ndarray, " N"], sample: int, box: Box, sign: float
) -> Attack:
    """Attack under which the signal row' z(sample) is largest in the direction of `sign`.

    >>> from jcontour.plants import bridgeport
    >>> import jax.numpy as jnp
    >>> M, E = 0.5 * jnp.ones((3, 1, 1)), jnp.ones((3, 1, 1))
    >>> none = jnp.zeros((3, 1, 0))
    >>> loop = DisturbedLoop(M, E, M, M, none, M[0], M[0])
    >>> worst_attack(loop, jnp.ones(1), 2, Box.of(0.1, 0.0, 1, 0), -1.0).force.ravel().tolist()
    [-0.1, -0.1, 0.0]

    Raises:
        ValueError: there is no such sample.
    """
    inputs = box.force.size
    found = np.zeros((loop.E.shape[0], box.size.size))
    pushed = np.sign(coefficients(loop, row, sample))
    found[:sample] = np.where(sign < 0, -1.0, 1.0) * pushed * box.size
    return Attack(found[:, :inputs], found[:, inputs:])
