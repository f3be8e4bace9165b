"""Noise of encoders: in place of counts where a smooth machine is needed, and beside them."""

import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import placed

SAMPLES = 8192  # of a run that have noise of their own; the last one holds beyond
FARTHEST = 3.0  # deviations that noise never exceeds, so that it has a bound


def rounding_noise(positions: int, resolution: float | np.ndarray) -> Float[Array, "T q"]:
    """Noise of positions [m], even within half a count of all or of each; the same in every run.

    >>> noise = rounding_noise(2, 1e-6)
    >>> noise.shape, bool(abs(noise).max() <= 0.5e-6)
    ((8192, 2), True)
    """
    counts = np.random.default_rng(0).uniform(-0.5, 0.5, (SAMPLES, positions))
    return placed(resolution * counts)


def sensor_noise(positions: int, deviation: float | np.ndarray) -> Float[Array, "T q"]:
    """Gaussian noise of positions [m], within three deviations; the same in every run.

    Args:
        positions: how many.
        deviation: standard deviation [m], of all or of each.
    """
    drawn = np.random.default_rng(1).standard_normal((SAMPLES, positions))
    return placed(deviation * np.clip(drawn, -FARTHEST, FARTHEST))


def in_words(resolution: float | np.ndarray) -> str:
    """Counts of all axes, or of each.

    >>> in_words(1e-6), in_words(np.array([1e-6, 5e-6]))
    ('1 um', '1, 5 um')
    """
    return ", ".join(f"{1e6 * count:g}" for count in np.atleast_1d(resolution)) + " um"
