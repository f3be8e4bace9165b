import jax.numpy as jnp
import pytest

from tuning.loops import Looked, Loops
from tuning.objectives import LoopPeaks


class Gains(Loops):
    """Peaks of gains k on integrators of slope b in closed form, with g = b k, at two probes.

    z + g - 1 = 0;   |S| and |T| have their peaks at z = -1, |T| for g < 1 at z = 1

    Args:
        more: added to every spectral radius.
    """

    more: float = 0.0

    def matrices(self, plants, controller):
        gain = jnp.diagonal(plants.B, axis1=1, axis2=2) * controller.gains[None, :]
        size = jnp.abs(1 - gain)
        # taken, not compared: XLA may compute a number twice and round it differently
        radius = jnp.take_along_axis(size, jnp.argmax(size, axis=1, keepdims=True), axis=1)[:, 0]
        stable = (radius < 1)[:, None] & (gain < 2)
        below = jnp.where(stable, 2 - gain, 1.0)
        largest = jnp.max(jnp.where(stable, 2 / below, jnp.inf), axis=1)
        most = jnp.max(jnp.where(stable, jnp.maximum(1.0, gain / below), jnp.inf), axis=1)
        columns = (largest, most, radius + self.more, 0 * radius)
        return LoopPeaks(*(jnp.stack([peak, peak]) for peak in columns))

    def look(self, matrices, slopes):
        return Looked(matrices), Looked(slopes)


class Counting(Gains):
    """The same loops, and beside them a mode of radius 1, as of a counter."""

    def matrices(self, plants, controller):
        peaks = super().matrices(plants, controller)
        return peaks._replace(spectral_radius=jnp.maximum(peaks.spectral_radius, 1.0))


@pytest.fixture(scope="session")
def counting_loops():
    return Counting()


@pytest.fixture(scope="session")
def loop_peaks():
    return Gains()


@pytest.fixture(scope="session")
def unstable_loops():
    """Loops that no gain makes stable."""
    return Gains(1.0)
