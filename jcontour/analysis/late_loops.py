"""Frozen loops whose control acts some samples later: largest spectral radius, and its slope. Host.

A loop that is stable with 1, 2, ... and d more samples on its control has a delay margin of d
samples. One of them alone says little: a resonance that a short delay makes unstable may be stable
again under a longer one.
"""

import jax
import numpy as np
from jaxtyping import Float, Int

from jcontour.analysis.frozen_loops import CutLoops, FrozenLoop, LinearLaw, LinearMachine
from jcontour.analysis.spectral import dominant, real_outer, times
from jcontour.linear.plant import spectral_radius


def late_measures(loop: FrozenLoop, samples: int) -> tuple[Float[np.ndarray, "*loops"], FrozenLoop]:
    """Largest spectral radius of the loops with v(k) = u(k - d), d = 1 ... samples, and its slope.

    With left and right vectors of the largest eigenvalue, of x, w and the line u(k-1), ..., u(k-d),
    the derivative is that of Re(left' M right) (`spectral.dominant`). A loop that is not finite has
    an infinite radius with slope 0.

    Args:
        loop: batched in front; plant and controller may have different batches that go together.
        samples: at least 1.

    Raises:
        ValueError: fewer samples.
    """
    if samples < 1:
        raise ValueError(f"samples: needs a delay of one at least, received {samples}")
    radius, slope = _late(loop, 1)
    for delay in range(2, samples + 1):
        other, other_slope = _late(loop, delay)
        larger = other > radius
        radius = np.where(larger, other, radius)
        kept = larger[..., None, None]
        slope = jax.tree.map(lambda a, b, kept=kept: np.where(kept, a, b), other_slope, slope)
    return radius, slope


def delay_margins(loop: FrozenLoop, most: int) -> Int[np.ndarray, "*loops"]:
    """Most samples d such that every delay from 0 to d leaves the loop stable.

    -1 where the loop is unstable without one; larger margins than `most` are not followed.

    Args:
        loop: batched in front; plant and controller may have different batches that go together.
        most: at least 0.
    """
    cut = [np.asarray(matrices, float) for matrices in loop.cut()]
    batch = np.broadcast_shapes(*(matrices.shape[:-2] for matrices in cut))
    flat = [
        np.broadcast_to(one, (*batch, *one.shape[-2:])).reshape(-1, *one.shape[-2:]) for one in cut
    ]
    # loops of several probes are the same where the controller does not change along the path
    rows = np.concatenate([one.reshape(len(one), -1) for one in flat], axis=1)
    _, once, alike = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    loops = CutLoops(*flat).at(once)
    margin = np.where(spectral_radius(loops.closed()) < 1, 0, -1)
    for delay in range(1, most + 1):
        left = np.flatnonzero(margin == delay - 1)
        if left.size == 0:
            break
        margin[left[spectral_radius(loops.at(left).late(delay)) < 1]] = delay
    return margin[alike.ravel()].reshape(batch)


def _late(loop: FrozenLoop, samples: int) -> tuple[np.ndarray, FrozenLoop]:
    """Spectral radius with one delay, and its derivative."""
    M = np.asarray(loop.cut().late(samples), float)
    finite = np.asarray(np.isfinite(M).all(axis=(-2, -1)))
    found = dominant(np.where(finite[..., None, None], M, 0.0))
    kept = np.where(finite, 1.0, 0.0)[..., None]
    slope = _slope(loop, samples, kept * found.left, kept * found.right)
    return np.where(finite, found.radius, np.inf), slope


def _slope(loop: FrozenLoop, samples: int, left, right) -> FrozenLoop:
    """Derivative of Re(left' M right) with respect to the matrices of the loop.

    The plant hears the last of the line, the controller writes its first.
    """
    (_, _, H), (_, E, _, D) = (
        [np.nan_to_num(np.asarray(matrix, float)) for matrix in part] for part in loop
    )
    n, c, p = H.shape[-1], E.shape[-2], D.shape[-2]
    x, w, heard = right[..., :n], right[..., n : n + c], right[..., n + c + (samples - 1) * p :]
    of_x, of_w, written = left[..., :n], left[..., n : n + c], left[..., n + c : n + c + p]
    y = times(H, x)
    of_y = times(np.swapaxes(E, -1, -2), of_w) + times(np.swapaxes(D, -1, -2), written)
    return FrozenLoop(
        LinearMachine(real_outer(of_x, x), real_outer(of_x, heard), real_outer(of_y, x)),
        LinearLaw(
            real_outer(of_w, w), real_outer(of_w, y), real_outer(written, w), real_outer(written, y)
        ),
    )
