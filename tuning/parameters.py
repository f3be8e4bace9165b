"""Constraints of weights: a tree that mirrors the tree of weights.

    space = LQWeights-shaped tree, one entry per weight:  Positive() | Interval(low, high) | Free()
    | Fixed()

Each entry maps its weight to an unbounded coordinate z, in which the tuner moves without limits.
"""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Weights = Any  # any pytree of arrays


class Parameter(eqx.Module):
    """Constraint of one weight, a scalar or an array.

    `reach` is how far its coordinate may go from that of the start: beyond, ratios have no meaning.
    """

    reach: ClassVar[float] = 25.0

    @abc.abstractmethod
    def coordinate(self, weight: Float[Array, "..."]) -> Float[Array, "..."]:
        """z of a weight."""

    @abc.abstractmethod
    def weight(self, z: Float[Array, "..."]) -> Float[Array, "..."]:
        """Weight at z."""

    @abc.abstractmethod
    def allows(self, weight: Float[np.ndarray, "..."]) -> bool:
        """Whether a weight lies inside."""


class Positive(Parameter):
    """w = exp z: any positive weight, moved by ratios.

    >>> round(float(Positive().weight(Positive().coordinate(3.0))), 12)
    3.0
    """

    def coordinate(self, weight):
        return jnp.log(weight)

    def weight(self, z):
        return jnp.exp(z)

    def allows(self, weight) -> bool:
        return bool(np.all(weight > 0))


class Interval(Parameter):
    """Strictly between two bounds.

    The scale is logarithmic when both are positive, so that decades count alike.

    >>> round(float(Interval(0.01, 100.0).weight(0.0)), 12)  # the middle of four decades
    1.0

    Raises:
        ValueError: the bounds are not finite or not in order.
    """

    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)

    def __check_init__(self):
        if not (np.isfinite(self.low) and np.isfinite(self.high) and self.low < self.high):
            raise ValueError(
                "Interval: needs finite bounds with low < high, "
                f"received {self.low} and {self.high}"
            )

    def coordinate(self, weight):
        low, high = self._scaled(jnp.asarray([self.low, self.high]))
        place = (self._scaled(weight) - low) / (high - low)
        return jnp.log(place / (1 - place))

    def weight(self, z):
        low, high = self._scaled(jnp.asarray([self.low, self.high]))
        mixed = low + (high - low) * jax.nn.sigmoid(z)
        return jnp.exp(mixed) if self.low > 0 else mixed

    def allows(self, weight) -> bool:
        return bool(np.all((self.low < weight) & (weight < self.high)))

    def _scaled(self, value):
        return jnp.log(value) if self.low > 0 else value


class Free(Parameter):
    """w = z: any real number."""

    reach: ClassVar[float] = np.inf

    def coordinate(self, weight):
        return weight

    def weight(self, z):
        return z

    def allows(self, weight) -> bool:
        return True


class Fixed(Parameter):
    """Not tuned."""

    def coordinate(self, weight):
        return jnp.zeros((0,))

    def weight(self, z):
        raise AssertionError("a fixed weight has no coordinate")

    def allows(self, weight) -> bool:
        return True


class Weight(NamedTuple):
    """Description of a weight of a controller: a class lists its own as `weights`.

    Attributes:
        name: that it is given, printed and stored by.
        unit: of its numbers; `{control}` stands for the machine's unit of the control.
        range: where it may go, or a function that finds it for a machine.
        start: where it begins, one number or one for each axis, or a function that finds it for a
            machine. None where the controller says.
        cost: it is a weight of a quadratic cost.
    """

    name: str
    unit: str = ""
    range: Parameter | Callable[[Any], Parameter] = Positive()
    start: Any = None
    cost: bool = False


class Chart(NamedTuple):
    """Coordinates of a space around a start; every fixed weight stays as it started.

    >>> chart = Chart({"gain": Positive(), "time": Fixed()}, {"gain": 2.0, "time": 0.5})
    >>> chart.coordinates().shape
    (1,)
    >>> float(chart.weights(jnp.zeros(1))["gain"])
    1.0
    """

    space: Any
    start: Weights

    def coordinates(self) -> Float[Array, " d"]:
        """z (d,) of the start.

        Raises:
            ValueError: the space does not mirror the weights, a start lies outside of its
                parameter, or nothing is free.
        """
        parts = []
        for (path, parameter), weight in zip(*self._pairs(), strict=True):
            if not parameter.allows(np.asarray(weight)):
                raise ValueError(
                    f"{jax.tree_util.keystr(path)}: the start {weight} lies outside of {parameter}"
                )
            parts.append(jnp.ravel(parameter.coordinate(jnp.asarray(weight))))
        z = jnp.concatenate(parts)
        if z.size == 0:
            raise ValueError("space: every weight is fixed, nothing is left to tune")
        return z

    def reach(self) -> Float[np.ndarray, " d"]:
        """How far every coordinate may go from the start."""
        pairs = zip(*self._pairs(), strict=True)
        free = [(one, np.size(weight)) for (_, one), weight in pairs if not isinstance(one, Fixed)]
        return np.concatenate([np.full(size, one.reach) for one, size in free])

    def weights(self, z: Float[Array, " d"]) -> Weights:
        """Weights at z."""
        pairs, start = self._pairs()
        leaves, at = [], 0
        for (_, parameter), weight in zip(pairs, start, strict=True):
            if isinstance(parameter, Fixed):
                leaves.append(weight)
                continue
            size = jnp.size(weight)
            leaves.append(parameter.weight(z[at : at + size].reshape(jnp.shape(weight))))
            at += size
        return jax.tree.unflatten(jax.tree.structure(self.start), leaves)

    def _pairs(self):
        parameters = jax.tree_util.tree_leaves_with_path(
            self.space, is_leaf=lambda node: isinstance(node, Parameter)
        )
        weights = jax.tree.leaves(self.start)
        if len(parameters) != len(weights):
            raise ValueError(
                f"space: needs one parameter per weight, "
                f"received {len(parameters)} for {len(weights)} weights"
            )
        return parameters, weights
