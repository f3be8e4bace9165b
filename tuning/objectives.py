"""Objectives and limits.

An objective is a function of the Outcome, with axes (contour, plant), whose values are made small.

It returns rows of positive values v (g, v). A row counts by its largest value, the rows count by
their geometric mean:

    f = (prod over rows r of max over i of v[r, i])^(1/g)

One row is a worst case. A row per contour lets no contour in micrometres drown another one.

| | rows | value |
|---|---|---|
| worst | one | the largest error of all |
| mean | one | the mean error |
| typical | one per contour | the geometric mean of the family's worst of every contour |

Limits are a function of the Outcome. It returns a vector that must not be above zero,
ln(value / limit), so that a per cent counts alike on every machine.

Outcome of weights: what objectives and limits judge.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour.analysis.sensitivity import LoopPeaks
from jcontour.linear.plant import ROUNDING
from jcontour.simulation.limit_use import LimitUse
from jcontour.simulation.metrics import Metrics

LEAST = 1e-30  # error [m], or ratio: nothing measurable is smaller, and ln 0 would have no slope
LOOP_LIMITS = {  # name of the limit -> field of LoopPeaks
    "peak_sensitivity": "sensitivity",
    "peak_complementary_sensitivity": "complementary",
    "spectral_radius": "spectral_radius",
    "response_doubt": "uncertainty",
}
LATE = "late_radius"
COUNT_NOISE = "count_noise"
RATIO = "error_ratio"
USE_LIMITS = {f"{name}_use": name for name in LimitUse._fields}  # likewise of LimitUse


class Outcome(NamedTuple):
    """Metrics of all runs, and peaks of the frozen loops where the problem asks for them.

    Attributes:
        metrics: axes (contour, plant).
        loops: axes (probe, plant); None for a problem without windows.
        use: of the machine's limits, axes (contour, plant); None for a problem without them.
        late: spectral radius of the loops with more delay, axes (probe, plant); None where the
            problem does not ask for it.
        count_noise: RMS of the control by the counts of encoders [control unit], axes
            (probe, plant); None where the problem does not ask for it.
    """

    metrics: Metrics
    loops: LoopPeaks | None = None
    use: LimitUse | None = None
    late: Float[Array, "K P"] | None = None
    count_noise: Float[Array, "K P"] | None = None

    @property
    def diverged(self) -> Bool[Array, ""]:
        """Whether any run diverges, or any frozen loop is unstable as far as a double can tell."""
        lost = jnp.any(self.metrics.diverged)
        if self.loops is None:
            return lost
        return lost | ~jnp.all(self.loops.spectral_radius < 1 - ROUNDING)


Objective = Callable[[Outcome], Float[Array, "g v"]]
Limits = Callable[[Outcome], Float[Array, " c"]]


def worst_contour_error(outcome: Outcome) -> Float[Array, "1 v"]:
    """RMS contour error [m] of every contour c and plant p in one row: f = max over c, p of e."""
    return jnp.ravel(outcome.metrics.rms_contour_error)[None]


def worst_increment(outcome: Outcome) -> Float[Array, "1 v"]:
    """RMS control increment du of every contour c and plant p in one row: f is the largest."""
    return jnp.ravel(outcome.metrics.rms_increment)[None]


def mean_contour_error(outcome: Outcome) -> Float[Array, "1 1"]:
    """Mean over contours and plants of the RMS contour error [m]: f = mean over c, p of e."""
    return jnp.mean(outcome.metrics.rms_contour_error)[None, None]


def typical_contour_error(outcome: Outcome) -> Float[Array, "c p"]:
    """RMS contour error [m], a row per contour: f = (prod over c of max over p of e)^(1/C).

    A per cent of any contour counts alike, however large its error.
    """
    return jnp.asarray(outcome.metrics.rms_contour_error)


def worst_tracking_error(outcome: Outcome) -> Float[Array, "1 v"]:
    """RMS tracking error [m] of every contour c and plant p in one row: f = max over c, p of e."""
    return jnp.ravel(outcome.metrics.rms_tracking_error)[None]


def mean_tracking_error(outcome: Outcome) -> Float[Array, "1 1"]:
    """Mean over contours and plants of the RMS tracking error [m]: f = mean over c, p of e."""
    return jnp.mean(outcome.metrics.rms_tracking_error)[None, None]


def typical_tracking_error(outcome: Outcome) -> Float[Array, "c p"]:
    """RMS tracking error [m], a row per contour: f = (prod over c of max over p of e)^(1/C)."""
    return jnp.asarray(outcome.metrics.rms_tracking_error)


class Before(eqx.Module):
    """Errors before the tuning, which a limit on `error_ratio` compares with."""

    # the family's worst RMS error of every contour [m]; infinite where nothing is asked
    errors: Float[Array, " c"]
    # which RMS error counts
    error: Literal["contour", "tracking"] = eqx.field(static=True, default="contour")


class Entry(NamedTuple):
    """One entry of the limits."""

    name: str  # of the limit
    row: int  # index of the contour, or of the probe for a limit on the loops
    plant: int  # index in the family


def no_limits(outcome: Outcome) -> Float[Array, " 0"]:
    """Nothing to respect."""
    return jnp.zeros((0,), outcome.metrics.rms_contour_error.dtype)


class AtMost(eqx.Module):
    """Limits by name: on metrics for every contour and plant, on loops for every probe and plant.

    >>> limits = AtMost(rms_increment=0.114, peak_sensitivity=2.0)
    >>> limits.names
    ('rms_increment', 'peak_sensitivity')

    Names are those of `Metrics`, `peak_sensitivity`, `peak_complementary_sensitivity` and
    `spectral_radius` of the loops, `response_doubt` for what is not known of the response (1 is all
    that a loop bears), `late_radius` for the largest spectral radius with more delay,
    `count_noise` for the RMS of the control by the counts of encoders,
    `error_ratio` for the RMS error over that of `before`, and `speed_use`, `acceleration_use`,
    `control_use`, `increment_use`: 1 is all that the machine has.
    The bounds are arrays, so that problems which differ in them only share one compiled program.

    Args:
        before: errors that `error_ratio` compares with.
        limits: bound by name.

    Raises:
        ValueError: an unknown name, a limit that is not positive, a peak sensitivity that is not
            above 1, which no loop reaches, or an error ratio and nothing to compare with.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    bounds: Float[Array, " k"]
    before: Before | None

    def __init__(self, before: Before | None = None, /, **limits: float):
        known = [name for name in Metrics.__dataclass_fields__ if name != "diverged"]
        known += [*LOOP_LIMITS, LATE, COUNT_NOISE, RATIO, *USE_LIMITS]
        if RATIO in limits and before is None:
            raise ValueError(f"{RATIO}: needs the errors before the tuning, received none")
        for name, limit in limits.items():
            if name not in known:
                raise ValueError(
                    f"{name}: there is no such metric to limit; known are {', '.join(known)}"
                )
            if not limit > 0:
                raise ValueError(f"{name}: a limit needs to be positive, received {limit}")
            if name == "peak_sensitivity" and not limit > 1:
                raise ValueError(f"{name}: a limit needs to be above 1, received {limit}")
        self.names, self.bounds = tuple(limits), jnp.asarray(list(limits.values()), float)
        self.before = before

    def __call__(self, outcome: Outcome) -> Float[Array, " c"]:
        """ln(value / limit), one entry per limit, row and plant.

        Raises:
            ValueError: the loops are limited, and the outcome has none.
        """
        parts = [
            jnp.ravel(logarithm(self._values(outcome, name) / bound))
            for name, bound in zip(self.names, self.bounds, strict=True)
        ]
        return jnp.concatenate(parts) if parts else no_limits(outcome)

    def entries(self, outcome: Outcome) -> list[Entry]:
        """The entries of the vector, in its order."""
        return [
            Entry(name, row, plant)
            for name in self.names
            for row, plant in np.ndindex(*self._values(outcome, name).shape)
        ]

    def _values(self, outcome: Outcome, name: str) -> Float[Array | np.ndarray, "rows plants"]:
        if name != RATIO:
            return _values(outcome, name)
        assert self.before is not None  # `__init__` asks for it
        errors = getattr(outcome.metrics, f"rms_{self.before.error}_error")
        return errors / self.before.errors[:, None]


def _values(outcome: Outcome, name: str) -> Float[Array | np.ndarray, "rows plants"]:
    if name in USE_LIMITS:
        if outcome.use is None:
            raise ValueError(f"{name}: needs a problem with the limits of its machine")
        return getattr(outcome.use, USE_LIMITS[name])
    if name == LATE:
        if outcome.late is None:
            raise ValueError(f"{name}: needs a problem that looks at loops with more delay")
        return outcome.late
    if name == COUNT_NOISE:
        if outcome.count_noise is None:
            raise ValueError(f"{name}: needs a problem that looks at the noise of counts")
        return outcome.count_noise
    if name not in LOOP_LIMITS:
        return getattr(outcome.metrics, name)
    if outcome.loops is None:
        raise ValueError(f"{name}: a limit on the loops needs a problem with windows")
    return getattr(outcome.loops, LOOP_LIMITS[name])


def logarithm(value: Float[Array | np.ndarray, "..."]) -> Float[Array, "..."]:
    """Logarithm of what is not negative; finite, with a slope, at zero."""
    return jnp.log(jnp.maximum(value, LEAST))
