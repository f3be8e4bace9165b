"""Positions and velocities of the axes within the measurement of a plant."""

from collections.abc import Iterable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Sensors(eqx.Module):
    """Places of the axes' positions and velocities in the measurement, and its unit.

    The places are indices into all leaves of the measurement, one after the other.

    Args:
        position: indices (m,).
        velocity: indices (m,); none for a machine that measures positions only.
        scale: m per unit of the measurement: one number, or one for each axis.

    Raises:
        ValueError: different numbers of indices, or a negative one.
    """

    position: tuple[int, ...] = eqx.field(static=True)
    velocity: tuple[int, ...] = eqx.field(static=True)
    scale: Float[Array, "*m"]

    def __init__(self, position: Iterable[int], velocity: Iterable[int] = (), scale=1.0):
        self.position = tuple(int(i) for i in position)
        self.velocity = tuple(int(i) for i in velocity)
        alike = not self.velocity or len(self.position) == len(self.velocity)
        if not alike or not self.position or min(self.position + self.velocity) < 0:
            raise ValueError(
                "sensors: need as many positions as velocities, none negative, "
                f"received {self.position} and {self.velocity}"
            )
        self.scale = jnp.asarray(scale, float)

    @property
    def axes(self) -> int:
        """Number of axes m."""
        return len(self.position)

    def positions(self, measurement: Any) -> Float[Array, " m"]:
        """Position of every axis [m].

        Raises:
            ValueError: the measurement has fewer numbers than the places ask for.
        """
        return _scaled(self.scale, measurement, self.position)

    def read(self, measurement: Any) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """Position [m] and velocity [m/s] of every axis; errors as `positions`."""
        return self.positions(measurement), _scaled(self.scale, measurement, self.velocity)


def row(measurement: Any) -> Float[Array, " q"]:
    """All leaves of a measurement, one after the other."""
    leaves = [jnp.ravel(leaf) for leaf in jax.tree.leaves(measurement)]
    return leaves[0] if len(leaves) == 1 else jnp.concatenate(leaves)


@partial(jax.jit, static_argnums=2, inline=True)  # one program where none is around it
def _scaled(scale, measurement, places: tuple[int, ...]):
    numbers = row(measurement)
    if max(places, default=0) >= numbers.size:  # JAX would read the last one
        raise ValueError(
            f"sensors: there is no place {max(places)} in a measurement of {numbers.size} numbers, "
            "counted from 0"
        )
    return scale * numbers[np.array(places)]


def motors(axes: int) -> Sensors:
    """Sensors of a machine that measures all motor positions, then all motor speeds."""
    return Sensors(range(axes), range(axes, 2 * axes))
