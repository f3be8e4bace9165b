"""Errors and metrics of a run along its contour.

Tracking error  e(k) = y(k) - y_d(k)            distance to the desired tool point of now
Projected error eps(k) = (I - r r') e(k)        McNab & Tsao, eq. 3
Contour error   min over s of |y(k) - p(s)|     distance to the path, near the current progress

On one axis the path is the travel: the projected error is zero, and the contour error is what lies
beyond the ends of the travel.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Shaped

from jcontour._arrays import in_words, largest
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import Rollout

# tracking errors: the nearest point lies within a chord of 2 |e|, on an arc of up to half a circle
SEARCH_REACH = np.pi


class Metrics(eqx.Module):
    """Root mean squares and peaks of vector norms over the scored samples, in SI units.

    Errors in metres, controls in the plant's unit; an increment is u(k) - u(k-1) between two scored
    samples; `duration` [s]; `diverged` tells that the run left the contour by more than its size,
    or is not finite: its numbers mean nothing.
    """

    rms_contour_error: Float[Array | np.ndarray, "*runs"]
    peak_contour_error: Float[Array | np.ndarray, "*runs"]
    rms_projected_error: Float[Array | np.ndarray, "*runs"]
    peak_projected_error: Float[Array | np.ndarray, "*runs"]
    rms_tracking_error: Float[Array | np.ndarray, "*runs"]
    peak_tracking_error: Float[Array | np.ndarray, "*runs"]
    rms_control: Float[Array | np.ndarray, "*runs"]
    peak_control: Float[Array | np.ndarray, "*runs"]
    rms_increment: Float[Array | np.ndarray, "*runs"]
    peak_increment: Float[Array | np.ndarray, "*runs"]
    duration: Float[Array | np.ndarray, "*runs"]
    diverged: Bool[Array | np.ndarray, "*runs"]

    def __repr__(self) -> str:
        lines = [f"    {name:<16} {line}" for name, line in self._lines().items()]
        return "\n".join(["Metrics", *lines])

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        cells = (f"<tr><th>{name}</th><td>{line}</td></tr>" for name, line in self._lines().items())
        return f"<table>{''.join(cells)}</table>"

    def _lines(self) -> dict[str, str]:
        return {
            "contour error": _norms(self.rms_contour_error, self.peak_contour_error, "um", 1e6),
            "projected error": _norms(
                self.rms_projected_error, self.peak_projected_error, "um", 1e6
            ),
            "tracking error": _norms(self.rms_tracking_error, self.peak_tracking_error, "um", 1e6),
            "control": _norms(self.rms_control, self.peak_control),
            "increment": _norms(self.rms_increment, self.peak_increment),
            "duration": in_words(self.duration, "s"),
            "diverged": _whether(self.diverged),
        }


def _norms(rms: Any, peak: Any, unit: str = "", scale: float = 1.0) -> str:
    return f"rms {in_words(rms, unit, scale)}, peak {in_words(peak, unit, scale)}"


def _whether(diverged: Any) -> str:
    """Yes or no for one run, a count for several."""
    if isinstance(diverged, Tracer) or not hasattr(diverged, "shape"):
        return in_words(diverged)
    lost = np.asarray(diverged)
    if lost.ndim:
        return f"{int(lost.sum())} of {lost.size} runs"
    return "yes: its numbers mean nothing" if lost else "no"


@jax.jit
def tracking_error(
    output: Float[Array | np.ndarray, "T *runs m"], reference: Reference
) -> Float[Array, "T *runs m"]:
    """Tracking error e = y - y_d [m]."""
    return jnp.asarray(output) - _over_runs(reference.position[: reference.steps], output)


@jax.jit
def projected_error(
    output: Float[Array | np.ndarray, "T *runs m"], reference: Reference
) -> Float[Array, "T *runs m"]:
    """Projected error eps = (I - r r') e [m]: the linear estimate of the contour error.

    McNab & Tsao, eq. 3.
    """
    error = tracking_error(output, reference)
    tangent = _over_runs(reference.tangent[: reference.steps], output)
    return error - jnp.sum(error * tangent, axis=-1, keepdims=True) * tangent


@jax.jit
def contour_error(
    output: Float[Array | np.ndarray, "T *runs m"], reference: Reference
) -> Float[Array, "T *runs m"]:
    """Contour error y - p(s*) [m], s* the nearest point around the sample's arc length.

    The search is held fixed under differentiation, which is exact for the distance: (y - p) is
    normal to the path there.
    """
    error = _norm(jax.lax.stop_gradient(tracking_error(output, reference)))
    # a diverged sample is not worth a search
    reach = jnp.where(error <= reference.contour.size, SEARCH_REACH * error, 0.0)
    arc = _over_runs(reference.arc[: reference.steps], error)
    nearest = reference.contour.nearest(output, arc, reach)
    return output - reference.contour.position(nearest)


def score(rollout: Rollout, reference: Reference, window: tuple[int, int] | None = None) -> Metrics:
    """Metrics of a run over samples a..b-1 of `window`, all T steps when not given.

    >>> from jcontour import contours, feed_laws, references, simulate
    >>> from jcontour.controllers import ContouringLQ, LQWeights
    >>> from jcontour.plants import bridgeport
    >>> machine, path = bridgeport(), contours.circle(1e-3)
    >>> controller = ContouringLQ(machine, LQWeights(3.0, 5.0, 1e-6), preview=5)
    >>> arc = feed_laws.constant_feed(path, 10e-3, machine.dt)
    >>> reference = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    >>> metrics = score(simulate(machine, controller, reference), reference)
    >>> bool(metrics.diverged), bool(metrics.rms_contour_error < metrics.peak_contour_error)
    (False, True)

    A run that leaves its contour by more than its size is `diverged`; its other numbers mean
    nothing, and may be NaN with a NaN derivative. So look at `diverged` before them.

    Raises:
        ValueError: the window is empty, reaches beyond the run, or begins or ends in a step.
        TypeError: the arguments are swapped, or of another kind.
    """
    if isinstance(rollout, Reference) or not isinstance(reference, Reference):
        kinds = f"{type(rollout).__name__}, {type(reference).__name__}"
        raise TypeError(f"score(rollout, reference): needs a run and its Reference, got {kinds}")
    return _scored(rollout.output, rollout.control, reference, window)


@eqx.filter_jit
def _scored(output, control, reference: Reference, window: tuple[int, int] | None) -> Metrics:
    return score_signals(output, control, reference, window)


def score_signals(
    output, control, reference: Reference, window: tuple[int, int] | None = None
) -> Metrics:
    """Metrics from the two signals they need: outputs (T, m) [m] and controls (T, p).

    Axes between those two are runs of one reference, and then every number has these axes (*runs).
    """
    mask = scored_samples(reference, window)
    pairs = mask[1:] & mask[:-1]
    tracking = tracking_error(output, reference)
    distance = _norm(tracking)
    lost = jnp.where(_over_runs(mask, distance), ~(distance <= reference.contour.size), False)
    scored_control = jnp.where(_over_runs(mask, control), control, 0.0)
    duration = jnp.sum(mask).astype(output.dtype) * reference.dt
    return Metrics(
        *_rms_and_peak(contour_error(output, reference), mask),
        *_rms_and_peak(projected_error(output, reference), mask),
        *_rms_and_peak(tracking, mask),
        *_rms_and_peak(control, mask),
        *_rms_and_peak(jnp.diff(control, axis=0), pairs),
        duration=jnp.broadcast_to(duration, output.shape[1:-1]),
        diverged=jnp.any(lost, axis=0) | ~jnp.all(jnp.isfinite(scored_control), axis=(0, -1)),
    )


def scored_samples(reference: Reference, window: tuple[int, int] | None) -> Bool[Array, " T"]:
    """Which control steps count.

    Raises:
        ValueError: as `score`.
    """
    first, last = (0, reference.steps) if window is None else window
    whole = first % 1 == 0 and last % 1 == 0
    if not (whole and 0 <= first < last <= reference.steps):
        raise ValueError(
            f"window: needs whole numbers 0 <= a < b <= {reference.steps} steps, received {window}"
        )
    index = jnp.arange(reference.steps)
    return reference.mask[: reference.steps] & (index >= first) & (index < last)


def _rms_and_peak(
    vectors: Float[Array, "T *runs d"], mask: Bool[Array, " T"]
) -> tuple[Float[Array, "*runs"], Float[Array, "*runs"]]:
    square = jnp.sum(jnp.where(_over_runs(mask, vectors), vectors, 0.0) ** 2, axis=-1)
    # many runs: XLA for GPUs would compute the signal inside both reductions, which takes twice as
    # long as the loop
    if square.ndim > 1:
        square = jax.lax.optimization_barrier(square)
    count = jnp.maximum(jnp.sum(mask), 1).astype(square.dtype)
    mean = jnp.sum(square, axis=0) / count
    return _sqrt(mean), _sqrt(largest(square))


def _over_runs(
    samples: Shaped[Array, "T *one"], like: Shaped[Array | np.ndarray, "T *runs"]
) -> Shaped[Array, "T *spread"]:
    """Samples of the reference with as many axes as `like`, the new ones behind time."""
    return jnp.expand_dims(samples, tuple(range(1, 1 + like.ndim - samples.ndim)))


def _norm(vectors: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
    return _sqrt(jnp.sum(vectors**2, axis=-1))


def _sqrt(square: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    positive = square > 0
    root = jnp.sqrt(jnp.where(positive, square, 1.0))
    return jnp.where(positive, root, jnp.where(square == 0, 0.0, square))
