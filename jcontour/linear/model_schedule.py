"""Linear models of a machine that changes with the position of one of its outputs."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import is_concrete
from jcontour.linear.plant import LinearPlant


class ModelSchedule(eqx.Module):
    """Linear models over the position of one output, interpolated linearly entry by entry.

    Args:
        models: stacked on axis 0, one for every point.
        points: positions of the output [m], rising.
        output: its index.

    Raises:
        ValueError: fewer than two points, points out of order, or another number of models.
    """

    models: LinearPlant
    points: Float[Array, " N"]
    output: int = eqx.field(static=True)

    def __init__(self, models: LinearPlant, points, output: int):
        self.models, self.output = models, output
        self.points = jnp.asarray(points, float)
        several = self.points.ndim == 1 and self.points.size >= 2
        if not several or (is_concrete(points) and not np.all(np.diff(points) > 0)):
            raise ValueError(
                f"points: need two positions or more in rising order, received {points}"
            )
        if models.A.shape[0] != self.points.size:
            raise ValueError(
                f"models: need one for each of the {self.points.size} points, "
                f"received {models.A.shape[0]}"
            )

    def model(self, index: int) -> LinearPlant:
        """Model at one of the points."""
        return jax.tree.map(lambda leaf: leaf[index], self.models)

    def along(self, position: Float[Array, "S m"]) -> LinearPlant:
        """Models at every sample of a path, stacked on axis 0.

        Raises:
            ValueError: the path leaves the points. Where its values are traced the models are NaN
                there: the run counts as diverged.
        """
        return self.interpolated(self.models, position)

    def interpolated(self, values: Any, position: Float[Array, "S m"]) -> Any:
        """Arrays given at the points (axis 0), interpolated at every sample of a path.

        Raises:
            ValueError: as `along`.
        """
        at = position[..., self.output]
        if is_concrete(at, self.points):
            low, high = float(jnp.min(at)), float(jnp.max(at))
            first, last = float(self.points[0]), float(self.points[-1])
            if low < first or high > last:
                covered = f"the models cover {first:g} to {last:g} m of output {self.output}"
                raise ValueError(f"points: {covered}, the path goes from {low:g} to {high:g} m")
        left = jnp.clip(
            jnp.searchsorted(self.points, at, side="right") - 1, 0, self.points.size - 2
        )
        share = (at - self.points[left]) / (self.points[left + 1] - self.points[left])
        share = jnp.where((share >= 0) & (share <= 1), share, jnp.nan)

        def between(rows):
            weight = share.reshape(-1, *[1] * (rows.ndim - 1))  # as many axes as `rows`
            return (1 - weight) * rows[left] + weight * rows[left + 1]

        return jax.tree.map(between, values)
