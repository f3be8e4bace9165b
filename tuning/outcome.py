"""Outcome of weights: what objectives and limits judge."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jcontour.analysis.sensitivity import LoopPeaks
from jcontour.bounds.worst_cases import PeakValues
from jcontour.simulation.limit_use import LimitUse
from jcontour.simulation.metrics import Metrics


class Outcome(NamedTuple):
    """Metrics of all runs, and peaks of the frozen loops where the problem asks for them.

    Attributes:
        metrics: axes (contour, plant).
        loops: axes (probe, plant); None for a problem without windows.
        use: of the machine's limits, axes (contour, plant); None for a problem without them.
        late: spectral radius of the loops with more delay, axes (probe, plant); None where the
            problem does not ask for it.
        certified: largest errors and controls under bounded disturbances, axes (contour, plant);
            None for a problem that states no disturbances.
        count_noise: RMS of the control by the counts of encoders [control unit], axes
            (probe, plant); None where the problem does not ask for it.
    """

    metrics: Metrics
    loops: LoopPeaks | None = None
    use: LimitUse | None = None
    late: Float[Array, "K P"] | None = None
    certified: PeakValues | None = None
    count_noise: Float[Array, "K P"] | None = None

    @property
    def diverged(self) -> Bool[Array, ""]:
        """Whether any run diverges, or any frozen loop is unstable."""
        lost = jnp.any(self.metrics.diverged)
        if self.loops is None:
            return lost
        return lost | ~jnp.all(self.loops.spectral_radius < 1)
