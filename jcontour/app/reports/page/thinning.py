"""Samples of long signals that a page keeps: those that the eye would miss."""

import base64

import numpy as np
from jaxtyping import Float, Int


def kept_samples(signals: Float[np.ndarray, "S T"], most: int) -> Int[np.ndarray, " K"]:
    """Samples to keep, at most about `most`, the same ones of every signal.

    The run is cut into equal stretches. Of each stretch its first sample stays, and the one where
    each signal is largest, so that no peak is lost.

    >>> kept_samples(np.array([[0.0, 1.0, 9.0, 1.0, 0.0, 2.0, 1.0, 3.0]]), 4).tolist()
    [0, 2, 4, 7]

    Args:
        signals: sizes, at least zero; NaN counts as nothing.
        most: how many, at least two for each signal.
    """
    count, steps = signals.shape
    if steps <= most:
        return np.arange(steps)
    stretches = max(most // (count + 1), 1)
    edges = np.linspace(0, steps, stretches + 1).astype(int)
    sizes = np.where(np.isfinite(signals), signals, -1.0)
    kept = {0, steps - 1}
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        kept.add(int(first))
        kept.update((first + sizes[:, first:last].argmax(axis=1)).tolist())
    return np.array(sorted(kept))


def packed(values: Float[np.ndarray, "..."]) -> dict[str, str]:
    """Numbers for the page: base64 of little-endian float32, row by row."""
    return {"f32": base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()}
