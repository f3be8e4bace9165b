"""Second differences of a correction, kept within bounds.

    minimise over c  f(c)  with  least <= c'' <= most
by the alternating direction method of multipliers (Boyd, Parikh, Chu, Peleato & Eckstein 2011,
sections 3.1 to 3.4). c'' has a copy z within the bounds, with the scaled multiplier u:

    c <- argmin of f(c) + penalty mean |c'' - z + u|^2
    h <- RELAXED c'' + (1 - RELAXED) z,    z <- clip(h + u),    u <- u + h - z
They balance two residuals by the penalty. Here the cost is flat and the bounds count: the penalty
grows for as long as c'' is outside.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

RELAXED = 1.6
INSIDE = 0.97  # of the bounds, that z keeps: c'' comes near it, from both sides
FIRST = 10.0  # penalty beside errors of weight one
OUTSIDE = 0.01  # of the way between the bounds, beyond which the penalty grows
GROWTH = 1.4  # in a step: 2 is within sooner, and 1.3 times as far from the least error


class Bounds(NamedTuple):
    """Bounds |c'' - middle| <= reach of a correction's second difference [m] at every sample.

    A bent reference p + c with |p'' + c''| <= a dt^2 has the middle -p'' and the reach a dt^2.
    """

    middle: Float[np.ndarray, "T m"]
    reach: Float[np.ndarray, "T m"]  # infinite where there is none

    @classmethod
    def none(cls, steps: int, axes: int) -> "Bounds":
        """Of a correction that may bend as it likes."""
        return cls(np.zeros((steps, axes)), np.full((steps, axes), np.inf))

    @property
    def are_some(self) -> bool:
        """Whether anything is bounded."""
        return bool(np.isfinite(self.reach).any())

    @property
    def inner(self) -> tuple[Float[np.ndarray, "T m"], Float[np.ndarray, "T m"]]:
        """Least and greatest, a few per cent inside, but never without the straight correction."""
        reach = INSIDE * self.reach
        return np.minimum(self.middle - reach, 0.0), np.maximum(self.middle + reach, 0.0)

    def keep(self, correction: Float[np.ndarray, "T m"]) -> bool:
        """Whether a correction is within."""
        bend = np.asarray(bend_of(jnp.asarray(correction)))
        return bool(np.all(np.abs(bend - self.middle) <= self.reach))


class Copy(NamedTuple):
    """The copy of a bend.

    Attributes:
        place: z [m].
        multiplier: u [m].
        penalty: of their distance.
    """

    place: Float[Array, "T m"]
    multiplier: Float[Array, "T m"]
    penalty: Float[Array, ""]

    @classmethod
    def of(cls, bounds: Bounds) -> "Copy":
        """Of a straight correction; without bounds there is no penalty."""
        still = jnp.zeros(bounds.reach.shape)
        return cls(still, still, jnp.asarray(FIRST if bounds.are_some else 0.0))

    def after(self, bend: Float[Array, "T m"], within: tuple[Array, Array]) -> "Copy":
        """The copy, the multiplier and the penalty after a correction with this bend.

        Args:
            bend: c'' [m].
            within: least and greatest value of the copy [m].
        """
        passed = RELAXED * bend + (1 - RELAXED) * self.place
        place = jnp.clip(passed + self.multiplier, *within)
        multiplier = self.multiplier + passed - place
        least, most = within
        beyond = jnp.maximum(least - bend, bend - most)
        factor = jnp.where(jnp.any(beyond > OUTSIDE * (most - least)), GROWTH, 1.0)
        return Copy(place, multiplier / factor, factor * self.penalty)


def bend_of(correction: Float[Array, "T m"]) -> Float[Array, "T m"]:
    """Second difference c(k+1) - 2 c(k) + c(k-1); there is no shift before and after.

    >>> bend_of(jnp.array([[0.0], [1.0], [0.0]])).ravel().tolist()
    [1.0, -2.0, 1.0]
    """
    whole = jnp.pad(correction, ((1, 1), (0, 0)))
    return whole[2:] - 2 * whole[1:-1] + whole[:-2]


bend_back = bend_of  # its transpose: the matrix is symmetric


def eased(residual: Float[Array, "T m"], size: Array, rough: Array) -> Float[Array, "T m"]:
    """(sqrt(size) - sqrt(rough) D)^-2 of a residual, D the second difference."""
    steps = residual.shape[0]
    beside = jnp.full(steps, -jnp.sqrt(rough))
    middle = jnp.full(steps, jnp.sqrt(size) + 2 * jnp.sqrt(rough))
    lower, upper = beside.at[0].set(0.0), beside.at[-1].set(0.0)
    once = jax.lax.linalg.tridiagonal_solve(lower, middle, upper, residual)
    return jax.lax.linalg.tridiagonal_solve(lower, middle, upper, once)
