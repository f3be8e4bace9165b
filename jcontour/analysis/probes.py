"""Probes: the samples of a contour whose frozen loops stand for all of it. Host side.

A loop changes with the directions of the path over the preview, with the place of the machine and
with its speed. The probes of a contour are few, and differ in all of them.
"""

import jax
import numpy as np
from jaxtyping import Int

from jcontour.motion.references import Reference
from jcontour.simulation.evaluation import member

LAGS = 5  # samples of a window whose directions are compared, evenly over the preview
CANDIDATES = 4096  # samples of a long contour among which probes are sought


def probe_windows(references: Reference, count: int = 8) -> Reference:
    """Windows of one control step and the preview, `count` for each contour, on the host.

    Probes are the sharpest turn, the first and the last scored sample, then those that differ most
    from all chosen before: in the directions r r' over the preview, in the place on the contour,
    and in speed. A window starts in motion as the machine enters its sample.

    >>> from jcontour import contours, feed_laws, references
    >>> from jcontour.simulation.evaluation import stack_references
    >>> path = contours.polygon([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3]])
    >>> arc = feed_laws.constant_feed(path, 10e-3, 1e-3)
    >>> run = references.along(path, arc, 1e-3, preview=5, at_rest=False)
    >>> windows = probe_windows(stack_references([run]), count=4)
    >>> windows.steps, windows.position.shape
    (1, (4, 6, 2))

    Args:
        references: `stack_references([...])`, axis 0.
        count: windows for each contour; a contour with fewer scored samples repeats some.

    Returns:
        Stacked windows, those of the first contour first.

    Raises:
        ValueError: the count is below one, or a contour has no scored sample.
    """
    if count < 1:
        raise ValueError(f"count: needs at least one probe for each contour, received {count}")
    host = jax.tree.map(np.asarray, references)
    size = host.position.shape[0]
    chosen = [_numbered(member(host, k), count, k) for k in range(size)]
    contour = np.repeat(np.arange(size), count)
    start = np.concatenate(chosen)
    rows = start[:, None] + np.arange(references.preview + 1)

    def cut(values):
        return jax.device_put(values[contour[:, None], rows])

    entered = host.position[contour, start] - host.position[contour, np.maximum(start - 1, 0)]
    increment = np.where((start > 0)[:, None], entered, host.start_increment[contour])
    mask = np.broadcast_to(np.arange(references.preview + 1) == 0, rows.shape)
    return jax.vmap(lambda *arrays: Reference(*arrays, references.dt, 1))(
        cut(host.position),
        cut(host.tangent),
        cut(host.arc),
        jax.device_put(mask),
        jax.device_put(increment),
        jax.tree.map(lambda leaf: jax.device_put(leaf[contour]), host.contour),
    )


def probe_samples(reference: Reference, count: int) -> Int[np.ndarray, " {count}"]:
    """Sorted samples of one contour: the sharpest turn, the ends, and what differs most from them.

    Raises:
        ValueError: no sample is scored.
    """
    reference = jax.tree.map(np.asarray, reference)
    scored = np.flatnonzero(reference.mask[: reference.steps])
    if scored.size == 0:
        raise ValueError("reference: it has no scored sample to look at")
    # change of direction from the sample before to the one after
    tangent = reference.tangent
    index = np.arange(reference.steps)
    after = np.minimum(index + 1, len(tangent) - 1)
    turns = np.linalg.norm(tangent[after] - tangent[np.maximum(index - 1, 0)], axis=1)[scored]
    sharpest = int(np.argmax(turns))
    few = np.linspace(0, scored.size - 1, min(scored.size, CANDIDATES)).astype(int)
    kept = np.union1d(few, sharpest)
    # what a loop depends on (samples, numbers), each part up to about one
    samples = scored[kept]
    lags = np.unique(np.linspace(0, reference.preview, LAGS).astype(int))
    r = reference.tangent[samples[:, None] + lags]
    directions = (r[..., :, None] * r[..., None, :]).reshape(samples.size, -1) / np.sqrt(lags.size)
    place = reference.position[samples] / max(float(reference.contour.size), 1e-12)
    steps = np.diff(reference.position, axis=0, prepend=reference.position[:1])
    speed = np.linalg.norm(steps, axis=1)
    relative = speed[samples] / max(speed.max(), 1e-12)
    features = np.concatenate([directions, place, relative[:, None]], axis=1)
    first = [int(np.searchsorted(kept, sharpest)), 0, kept.size - 1]
    return np.sort(scored[kept[_spread(features, first, count)]])


def _numbered(reference: Reference, count: int, number: int) -> np.ndarray:
    try:
        return probe_samples(reference, count)
    except ValueError as error:
        raise ValueError(f"references: number {number}: {error}") from None


def _spread(features: np.ndarray, first: list[int], count: int) -> list[int]:
    """Rows: the first ones, then those farthest from all before; repeats only if none is left."""
    chosen, distance = [], np.full(len(features), np.inf)
    for k in range(count):
        new = first[k] if k < len(first) else int(np.argmax(distance))
        chosen.append(new)
        away = np.linalg.norm(features - features[new], axis=1)
        distance = np.minimum(distance, away)
    return chosen
