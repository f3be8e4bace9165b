"""Objectives and limits: functions of Metrics with axes (contour, plant).

An objective returns positive values; the largest is made small. A limit returns a vector that must
not be above zero, ln(value / limit), so that a per cent counts alike on every machine.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.simulation.metrics import Metrics

Objective = Callable[[Metrics], Float[Array, " v"]]
Limits = Callable[[Metrics], Float[Array, " c"]]


def mean_contour_error(metrics: Metrics) -> Float[Array, " 1"]:
    """Mean over contours and plants of the RMS contour error [m]."""
    return jnp.mean(metrics.rms_contour_error)[None]


def worst_contour_error(metrics: Metrics) -> Float[Array, " v"]:
    """RMS contour error [m] of every contour and plant: the worst case counts, exactly."""
    return jnp.ravel(metrics.rms_contour_error)


def mean_tracking_error(metrics: Metrics) -> Float[Array, " 1"]:
    """Mean over contours and plants of the RMS tracking error [m]."""
    return jnp.mean(metrics.rms_tracking_error)[None]


def worst_tracking_error(metrics: Metrics) -> Float[Array, " v"]:
    """RMS tracking error [m] of every contour and plant: the worst case counts, exactly."""
    return jnp.ravel(metrics.rms_tracking_error)


def no_limits(metrics: Metrics) -> Float[Array, " 0"]:
    """Nothing to respect."""
    return jnp.zeros((0,), metrics.rms_contour_error.dtype)


class AtMost(eqx.Module):
    """Limits on metrics by name, for every contour and plant.

    >>> limits = AtMost(rms_increment=0.114, rms_tracking_error=100e-6)
    >>> limits.names
    ('rms_increment', 'rms_tracking_error')

    The bounds are arrays, so that problems which differ in them only share one compiled program.

    Raises:
        ValueError: an unknown metric, or a limit that is not positive.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    bounds: Float[Array, " k"]

    def __init__(self, **limits: float):
        known = [name for name in Metrics.__dataclass_fields__ if name != "diverged"]
        for name, limit in limits.items():
            if name not in known:
                raise ValueError(
                    f"{name}: there is no such metric to limit; known are {', '.join(known)}"
                )
            if not limit > 0:
                raise ValueError(f"{name}: a limit needs to be positive, received {limit}")
        self.names, self.bounds = tuple(limits), jnp.asarray(list(limits.values()), float)

    def __call__(self, metrics: Metrics) -> Float[Array, " c"]:
        """ln(value / limit), one entry per limit, contour and plant."""
        parts = [
            jnp.ravel(_log(getattr(metrics, name) / bound))
            for name, bound in zip(self.names, self.bounds, strict=True)
        ]
        return jnp.concatenate(parts) if parts else no_limits(metrics)


def _log(value: Float[Array, "..."]) -> Float[Array, "..."]:
    least = 1e-30  # nothing measurable is smaller, and ln 0 would have no gradient
    return jnp.log(jnp.maximum(value, least))
