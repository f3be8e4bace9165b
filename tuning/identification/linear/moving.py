"""Where an axis surely moves one way."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from tuning.identification.linear import evidence

SLOWEST, FASTEST = 0.1, 99  # of the fast speed; percentile of the speeds that is fast


def moving(
    position: Float[np.ndarray, " T"], resolution: float
) -> tuple[Float[np.ndarray, " T"], list[tuple[int, int]]]:
    """Minus the sign of the speed, zero where it is not clear, and the pieces in which it is.

    By the motion over 2 to 16 samples, whichever first exceeds counts and noise [m]. As many
    samples as it reaches over are left out beside those that are not clear.
    """
    unclear = max(resolution, np.sqrt(2) * evidence.noise_of(position))
    signs = np.zeros(len(position))
    for half in evidence.HALVES:
        padded = np.pad(position, (half - 1, half), mode="edge")
        moved = padded[2 * half - 1 :] - padded[: len(position)]
        sure = np.where(np.abs(moved) > evidence.SLOW * unclear, np.sign(moved), 0.0)
        for start, end in _runs(sure):
            inner = slice(start + half, end - half)
            signs[inner] = np.where(signs[inner] == 0, sure[inner], signs[inner])
    return -signs, list(_runs(signs))


def quick(
    position: Float[np.ndarray, " T"], signs: Float[np.ndarray, " T"]
) -> list[tuple[int, int]]:
    """Pieces with a tenth at least of the record's fast speed: slower, dry friction may be another.

    By the motion over 16 samples [m], where the axis surely moves one way.
    """
    half = evidence.HALVES[-1]
    padded = np.pad(position, half, mode="edge")
    moved = np.abs(padded[2 * half :] - padded[: len(position)])
    sure = moved[signs != 0]
    if not sure.size:
        return []
    return list(_runs(np.where(moved >= SLOWEST * np.percentile(sure, FASTEST), signs, 0.0)))


def _runs(signs: Float[np.ndarray, " T"]) -> Iterator[tuple[int, int]]:
    """Stretches of one sign other than zero."""
    edges = [0, *(np.flatnonzero(np.diff(signs)) + 1), len(signs)]
    for start, end in pairwise(edges):
        if signs[start] != 0:
            yield int(start), int(end)
