"""Outcome of weights: what objectives and limits judge."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jcontour.simulation.metrics import Metrics


class LoopPeaks(NamedTuple):
    """Peaks of the frozen loops of every probe on every plant; infinite where a loop is unstable.

    Attributes:
        sensitivity: largest singular value of S over all frequencies.
        complementary: largest singular value of T over all frequencies.
        spectral_radius: of the closed loop; it is stable below 1.
    """

    sensitivity: Float[Array, "K P"]
    complementary: Float[Array, "K P"]
    spectral_radius: Float[Array, "K P"]


class Outcome(NamedTuple):
    """Metrics of all runs, and peaks of the frozen loops where the problem asks for them.

    Attributes:
        metrics: axes (contour, plant).
        loops: axes (probe, plant); None for a problem without windows.
    """

    metrics: Metrics
    loops: LoopPeaks | None = None

    @property
    def diverged(self) -> Bool[Array, ""]:
        """Whether any run diverges, or any frozen loop is unstable."""
        lost = jnp.any(self.metrics.diverged)
        if self.loops is None:
            return lost
        return lost | ~jnp.all(self.loops.spectral_radius < 1)
