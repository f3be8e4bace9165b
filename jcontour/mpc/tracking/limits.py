"""Limits of a constrained controller, one pair of bounds per signal."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.linear.plant import LinearPlant
from jcontour.qp.problem import check_limits

# (lower, upper), each one number or one per component; infinite where there is none
Numbers = ArrayLike | Sequence[float]
Bounds = tuple[Numbers, Numbers]


class Limits(NamedTuple):
    """Bounds over the whole horizon; None where there are none.

    Attributes:
        control: u (p,).
        increment: u_j - u_{j-1} (p,), the first against the control that acted last.
        state: x (n,).
        output: y (m,) [m].
        speed: (y_j - y_{j-1}) / dt (m,) [m/s].
        acceleration: (y_{j+1} - 2 y_j + y_{j-1}) / dt^2 (m,) [m/s^2], from the sample itself on:
            y_{-1} is that of the model, from which the last control led to the state.
    """

    control: Bounds | None = None
    increment: Bounds | None = None
    state: Bounds | None = None
    output: Bounds | None = None
    speed: Bounds | None = None
    acceleration: Bounds | None = None

    @classmethod
    def within(cls, **magnitudes: Numbers | None) -> "Limits":
        """Symmetric limits from magnitudes, by field; None is no limit."""
        sizes = {
            name: None if size is None else np.asarray(size, float)
            for name, size in magnitudes.items()
        }
        return cls(
            **{name: None if size is None else (-size, size) for name, size in sizes.items()}
        )


def full_limits(limits: Limits, model: LinearPlant) -> Limits:
    """Every field as a pair of float vectors, infinite where nothing was given.

    Raises:
        ValueError: a bound has the wrong number of components, is NaN, or bounds are crossed.
    """
    n, p, m = model.states, model.inputs, model.axes
    sizes = {"control": p, "increment": p, "state": n, "output": m, "speed": m, "acceleration": m}
    return Limits(**{name: bounds(name, getattr(limits, name), k) for name, k in sizes.items()})


def bounds(
    name: str, given: Bounds | None, size: int
) -> tuple[Float[np.ndarray, " size"], Float[np.ndarray, " size"]]:
    """Lower and upper bounds as float vectors, infinite where nothing was given.

    Raises:
        ValueError: as `full_limits`, naming the signal.
    """
    vectors = []
    for bound in (-np.inf, np.inf) if given is None else given:
        bound = np.asarray(bound, float)
        if bound.ndim > 1 or (bound.ndim == 1 and bound.size != size):
            raise ValueError(
                f"{name}: needs one bound or one per component, shape ({size},), "
                f"received {bound.shape}"
            )
        vectors.append(np.broadcast_to(bound, (size,)).copy())
    check_limits(name, *vectors)
    lower, upper = vectors
    return lower, upper
