"""Normalised recursive least squares with a dead zone and a constant trace.

Smith & Lee, (12)-(15):

    n = max(|phi|, n_0),  x = phi / n,  g = F x,  D = 1 + x'g,  e = y / n - x'theta
    theta+ = theta + g e / D,   F+ = (F - g g'/D) / l,   l = (tr F - g'g/D) / tr F(0)

(15) prints l = 1 - (g'g/D) / tr F(0). It keeps the trace only in exact arithmetic: rounding grows
by 1/l a step. With our l the trace is restored at every step. y in (12) is divided by the same n
as phi.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._tracing import is_concrete


class Estimate(NamedTuple):
    """Parameters and their gain; any batch of estimators."""

    theta: Float[Array, "*m q"]
    gain: Float[Array, "*m q q"]


class NormalisedLeastSquares(eqx.Module):
    """Estimator of y = theta . phi.

    >>> estimator = NormalisedLeastSquares(trace=2.0)
    >>> start = estimator.start(jnp.zeros(2))
    >>> learned = estimator.update(start, jnp.array([1.0, 0.0]), jnp.array(0.6))
    >>> learned.theta.tolist(), round(float(jnp.trace(learned.gain)), 12)
    ([0.3, 0.0], 2.0)

    Args:
        trace: tr F, which is kept.
        floor: n_0, in the unit of phi: below it phi is not scaled up.
        dead_zone: size of the error y - theta . phi up to which nothing is learned, one number or
            one for each y.

    Raises:
        ValueError: the trace or the floor is not above zero, or the dead zone is negative.
    """

    trace: Float[Array, ""]
    floor: Float[Array, ""]
    dead_zone: Float[Array, "*#m"]

    def __init__(self, trace: ArrayLike, floor: ArrayLike = 1.0, dead_zone: ArrayLike = 0.0):
        for name, value in (("trace", trace), ("floor", floor)):
            if is_concrete(value) and not (np.isfinite(value) and np.all(np.asarray(value) > 0)):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
        if is_concrete(dead_zone) and not np.all(np.asarray(dead_zone) >= 0):
            raise ValueError(f"dead_zone: cannot be negative, received {dead_zone}")
        self.trace, self.floor, self.dead_zone = (
            jnp.asarray(x, float) for x in (trace, floor, dead_zone)
        )

    def start(self, theta: Float[Array | np.ndarray, "*m q"]) -> Estimate:
        """First estimate: F = (trace / q) I."""
        theta = jnp.asarray(theta, float)
        size = theta.shape[-1]
        share = self.trace / size * jnp.eye(size, dtype=theta.dtype)
        return Estimate(theta, jnp.broadcast_to(share, (*theta.shape, size)))

    @jax.jit
    def update(
        self, estimate: Estimate, phi: Float[Array, "*m q"], y: Float[Array, "*m"]
    ) -> Estimate:
        """Estimate after one more sample."""
        theta, F = estimate
        # the square before the root: its slope is finite at phi = 0
        n = jnp.sqrt(jnp.maximum(jnp.sum(phi**2, axis=-1), self.floor**2))
        x = phi / n[..., None]
        g = jnp.einsum("...ij,...j->...i", F, x)
        D = 1 + jnp.sum(x * g, axis=-1)
        error = y / n - jnp.sum(theta * x, axis=-1)
        learned = theta + g * (error / D)[..., None]
        drop = jnp.sum(g**2, axis=-1) / D
        forgetting = (jnp.trace(F, axis1=-2, axis2=-1) - drop) / self.trace
        shrunk = F - g[..., :, None] * g[..., None, :] / D[..., None, None]
        kept = shrunk / forgetting[..., None, None]
        heard = jnp.abs(error * n) > self.dead_zone
        return Estimate(
            jnp.where(heard[..., None], learned, theta), jnp.where(heard[..., None, None], kept, F)
        )
