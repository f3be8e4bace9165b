"""References: a contour sampled along a feed law, with the preview samples appended.

T control steps are chosen first; a controller that looks N_p samples ahead needs S = T + N_p
samples. Sample k is the desired tool point at the time at which control k starts to act.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour._arrays import in_words, placed, shape, whole_number
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import polyline
from jcontour.geometry.coordinates import finite, positive

__all__ = [
    "Reference",
    "along",
    "from_samples",
    "in_time",
    "pad",
]

# times (S,) [s], none negative -> arc lengths (S,) [m]
TimeLaw = Callable[[np.ndarray], np.ndarray]
# of a contour's size: samples farther from it belong to another contour, or to another unit
FARTHEST = 0.01
BRANCHES = 8  # places on a contour that the first sample may belong to, looked at in full


class Reference(eqx.Module):
    """Samples of a contour in time.

    Attributes:
        position: desired tool point [m].
        tangent: unit vector along the motion.
        arc: arc length on `contour` [m].
        mask: which samples are scored (False: padding, rapid moves, preview).
        start_increment: motion per sample [m] with which the machine enters sample 0; zero is rest.
        contour: the geometry that the contour error is measured against.
        dt: sample period [s].
        steps: number of control steps T; the other S - T samples are preview.
    """

    position: Float[Array, "S m"]
    tangent: Float[Array, "S m"]
    arc: Float[Array, " S"]
    mask: Bool[Array, " S"]
    start_increment: Float[Array, " m"]
    contour: Contour
    dt: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)

    def __repr__(self) -> str:
        samples = f"{self.steps} steps of {in_words(self.dt, 'ms', 1e3)}"
        ahead = f"{shape(self.position)} [m] with what is previewed"
        return f"Reference({samples}, position {ahead}, {self.contour})"

    @property
    def preview(self) -> int:
        """Number of samples beyond the last control step."""
        return self.position.shape[-2] - self.steps

    @property
    def unpadded(self) -> Bool[Array, "*stack T"]:
        """Which control steps belong to the run: limits hold there, whether scored or not.

        A run that rests holds its end when it is padded, and all steps count. One in motion would
        stop at once there: its steps end `preview` samples before the last arc length is reached.
        """
        in_motion = jnp.any(self.start_increment != 0, axis=-1, keepdims=True)
        at_end = jnp.argmax(self.arc == self.arc[..., -1:], axis=-1, keepdims=True)
        scored = jnp.asarray(self.mask[..., : self.steps])
        index = jnp.cumsum(jnp.ones_like(scored, int), axis=-1) - 1
        return ~in_motion | (index <= at_end - self.preview) | scored

    def first(self, steps: int) -> "Reference":
        """The first control steps alone, with the same preview beyond them.

        Raises:
            ValueError: it is no whole number from 1 to the steps of the run.
        """
        if not (steps % 1 == 0 and 1 <= steps <= self.steps):
            raise ValueError(
                f"steps: the run has {self.steps} control steps, asked for the first {steps}"
            )
        steps = int(steps)
        seen = slice(0, steps + self.preview)
        rows = {name: getattr(self, name)[seen] for name in ("position", "tangent", "arc", "mask")}
        return replace(self, **rows, steps=steps)

    def aside(self, offset: np.ndarray, tangent: np.ndarray) -> "Reference":
        """The run beside its contour: offsets [m] and tangents of every control step, (T, m).

        The last offset is kept in the preview. Errors are still those from the contour.
        """
        more = [(0, self.preview), (0, 0)]
        position = np.asarray(self.position) + np.pad(offset, more, mode="edge")
        ahead = np.concatenate([tangent, np.asarray(self.tangent)[len(tangent) :]])
        return replace(self, position=placed(position), tangent=placed(ahead))


def from_samples(
    position,
    tangent,
    dt: float,
    preview: int,
    contour: Contour | None = None,
    in_motion: bool = True,
    tolerance: float | None = None,
) -> Reference:
    """Reference from sampled positions and tangents, preview samples included: T = S - preview.

    Where a contour meets or overlaps itself, the samples run on the branch that fits the positions
    and tangents of the whole run best; the first of branches that fit alike.

    >>> x = np.linspace(0.0, 1e-3, 21)
    >>> along_x = np.stack([np.ones(21), np.zeros(21)], axis=1)
    >>> reference = from_samples(np.stack([x, 0 * x], axis=1), along_x, dt=1e-3, preview=5)
    >>> reference.steps
    16

    Args:
        position: (S, m) [m].
        tangent: (S, m) unit vectors along the motion.
        dt: sample period [s].
        preview: how many of the samples are preview only.
        contour: true geometry for the contour error; the polyline through the samples when not
            given.
        in_motion: the machine enters sample 0 at position[1] - position[0] per sample; otherwise it
            stands there.
        tolerance: largest distance of a control step's sample from the contour [m]; a hundredth of
            the contour's size when not given. Preview samples may lie beyond the contour.

    Raises:
        ValueError: shapes differ, a value is not finite, a tangent is not a unit vector, a sample
            is farther from the contour than the tolerance, or no control step is left.
    """
    position, tangent = np.asarray(position, float), np.asarray(tangent, float)
    preview = whole_number("preview", preview)
    if position.ndim != 2 or position.shape[1] not in (1, 2, 3) or position.shape != tangent.shape:
        raise ValueError(
            "position, tangent: need the same shape (S, m), m from 1 to 3, "
            f"received {position.shape} and {tangent.shape}"
        )
    if len(position) < 2:
        raise ValueError(f"position: needs at least two samples, received {len(position)}")
    if contour is not None and contour.axes != position.shape[1]:
        raise ValueError(
            f"contour: needs as many axes as the samples, {position.shape[1]}, "
            f"received {contour.axes}"
        )
    finite("position", position)
    finite("tangent", tangent)
    worst = np.max(np.abs(np.linalg.norm(tangent, axis=1) - 1), initial=0.0)
    if worst > 1e-6:
        raise ValueError(
            f"tangent: needs unit vectors, received one whose length is off by {worst:.3g}"
        )
    if contour is None:
        contour = polyline(position)
        chords = np.linalg.norm(np.diff(position, axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(chords)])
    else:
        arc = _arc_on(contour, position, tangent)
        _check_on(contour, position[: len(position) - preview], arc, tolerance)
    increment = position[1] - position[0] if in_motion else np.zeros(position.shape[1])
    samples = _Samples(position, tangent, arc, np.ones(len(position), bool))
    return _reference(samples, contour, dt, preview, increment)


def in_time(
    contour: Contour, law: TimeLaw, duration: float, dt: float, preview: int = 1, dwell: float = 0.0
) -> Reference:
    """Reference that waits at the start of a contour, then follows a time law along it.

    It is exact at every sample. The control steps are at the times 0, dt, ..., duration; the
    preview samples after them follow the law too. It starts at rest.

    Args:
        contour: the path.
        law: arc length [m] at times since the end of the dwell [s]; see `point_to_point`.
        duration: of the whole run, dwell included [s].
        dt: sample period [s].
        preview: samples of future to append.
        dwell: wait before the law begins [s].

    Raises:
        ValueError: the duration is not a whole number of samples, at least one, the dwell is not
            between zero and the duration, or the preview is no whole number of samples.
    """
    steps = duration / dt
    if not (np.isfinite(steps) and steps >= 0.5 and abs(steps - round(steps)) < 1e-6):
        raise ValueError(
            f"duration: needs a whole number of samples of {dt} s, at least one, "
            f"received {duration} s"
        )
    if not 0 <= dwell <= duration:
        raise ValueError(
            f"dwell: needs to be from zero to the duration {duration} s, received {dwell} s"
        )
    preview = whole_number("preview", preview)
    time = np.arange(round(steps) + 1 + preview) * dt
    arc = finite("arc", law(np.maximum(time - dwell, 0.0)))
    position, tangent = _sampled(contour, arc)
    samples = _Samples(position, tangent, arc, np.ones(arc.size, bool))
    return _reference(samples, contour, dt, preview, np.zeros(position.shape[1]))


def along(contour: Contour, arc, dt: float, preview: int, at_rest: bool, scored=None) -> Reference:
    """Reference that visits `contour` at the arc lengths that a feed law gives.

    There is one arc length for each control step.

    >>> from jcontour import contours, feed_laws
    >>> path = contours.circle(10e-3)
    >>> arc = feed_laws.constant_feed(path, feed=50e-3, dt=1e-3)
    >>> reference = along(path, arc, dt=1e-3, preview=10, at_rest=False)
    >>> reference.steps, reference.position.shape
    (1257, (1267, 2))

    The preview samples appended after the last step
    hold the end of a run that ends at rest; otherwise they go on at the last increment, around a
    closed contour or straight on from an open one.

    Args:
        contour: the path.
        arc: (T,) arc length at each control step [m], as made by `feed_laws`. It never goes back;
            laps of a closed contour go on beyond its length.
        dt: sample period [s].
        preview: samples of future to append.
        at_rest: True for a rest-to-rest run; False when the machine enters and leaves the run at
            speed.
        scored: (T,) which samples count in the metrics; all when not given.

    Raises:
        ValueError: `arc` is not a finite vector of at least two samples or goes back, `scored` has
            another length, or `preview` is no whole number of samples.
    """
    arc, preview = np.asarray(arc, float), whole_number("preview", preview)
    if arc.ndim != 1 or arc.size < 2:
        raise ValueError(f"arc: needs shape (T,) with at least two samples, received {arc.shape}")
    finite("arc", arc)
    moves = np.diff(arc)
    back = int(np.argmin(moves))
    if moves[back] < -1e-9 * float(contour.size):
        raise ValueError(
            f"arc: may not go back, as it does after sample {back} by {-moves[back]:.4g} m; "
            "laps of a closed contour go on beyond its length"
        )
    last = 0.0 if at_rest else arc[-1] - arc[-2]
    arc = np.concatenate([arc, arc[-1] + last * np.arange(1, preview + 1)])
    position, tangent = _sampled(contour, arc)
    increment = np.zeros(position.shape[1]) if at_rest else position[1] - position[0]
    mask = np.ones(arc.size, bool)
    if scored is not None:
        counts = np.asarray(scored, bool)
        if counts.shape != (arc.size - preview,):
            raise ValueError(
                f"scored: needs shape ({arc.size - preview},), one per control step, "
                f"received {counts.shape}"
            )
        mask[: arc.size - preview] = counts
    samples = _Samples(position, tangent, arc, mask)
    return _reference(samples, contour, dt, preview, increment)


def pad(reference: Reference, steps: int) -> Reference:
    """Reference of the same run padded to `steps` control steps, so that runs batch.

    The last sample is held and not scored.

    Raises:
        ValueError: the run is longer than `steps`.
    """
    extra = steps - reference.steps
    if extra < 0:
        raise ValueError(
            f"steps: the run has {reference.steps} control steps, more than the {steps} asked for"
        )

    def hold(values):
        values = np.asarray(values)
        return jax.device_put(np.concatenate([values, np.repeat(values[-1:], extra, axis=0)]))

    rows = {name: hold(getattr(reference, name)) for name in ("position", "tangent", "arc")}
    mask = jax.device_put(np.concatenate([reference.mask, np.zeros(extra, bool)]))
    return replace(reference, **rows, mask=mask, steps=steps)


def _arc_on(contour: Contour, position: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Arc length of every sample [m], on the branch that fits the whole run."""
    chords = np.linalg.norm(np.diff(position, axis=0), axis=1)
    branches = _branches(contour, position[0], np.max(chords))
    arcs = [np.asarray(_projected(contour, position, first)) for first in branches]
    if len(arcs) == 1:
        return arcs[0]

    def misfit(arc: np.ndarray) -> float:
        """RMS distance over the RMS chord, plus the mean of 1 - cos of the angle between tangents.

        It is rounded, so that branches which fit alike tie.
        """
        apart = np.linalg.norm(position - contour.position(arc), axis=1)
        turned = 1 - np.sum(tangent * np.asarray(contour.tangent(arc)), axis=1)
        chord = max(np.sqrt(np.mean(chords**2)), 1e-9 * float(contour.size))
        return round(float(np.sqrt(np.mean(apart**2)) / chord + np.mean(turned)), 6)

    return arcs[int(np.argmin([misfit(arc) for arc in arcs]))]


def _branches(contour: Contour, point: np.ndarray, chord: float) -> np.ndarray:
    """Arc lengths [m] from the first one that the point may belong to.

    They are the nearest points of all pieces that are up to a chord farther than the nearest of
    all; one of several within two chords along the path.
    """
    rows = np.asarray(contour.mask)
    half = np.asarray(contour.extent)[rows] / 2
    middle = np.asarray(contour.start)[rows] + half
    arcs = np.asarray(contour.nearest(point[None], middle, half))
    apart = np.linalg.norm(np.asarray(contour.position(arcs)) - point, axis=1)
    kept: list[float] = []
    near = np.flatnonzero(apart <= apart.min() + max(chord, 1e-9 * float(contour.size)))
    for arc in arcs[near[np.argsort(apart[near], kind="stable")]]:
        if len(kept) < BRANCHES and all(_along(contour, arc, k) > 2 * chord for k in kept):
            kept.append(float(arc))
    return np.sort(kept)


def _along(contour: Contour, a: float, b: float) -> float:
    """Distance of two arc lengths along the path [m]."""
    apart, length = abs(a - b), float(contour.length)
    return min(apart, length - apart) if contour.closed else apart


def _check_on(contour: Contour, position: np.ndarray, arc: np.ndarray, tolerance: float | None):
    if len(position) == 0:
        return  # refused with the preview
    most = FARTHEST * float(contour.size) if tolerance is None else tolerance
    if not most >= 0:
        raise ValueError(f"tolerance: needs a distance in metres, received {tolerance}")
    on = np.asarray(contour.position(arc[: len(position)]))
    apart = np.linalg.norm(position - on, axis=1)
    worst = int(np.argmax(apart))
    if apart[worst] > most:
        raise ValueError(
            f"position: sample {worst} is {apart[worst]:.4g} m from the contour, "
            f"the tolerance is {most:.4g} m"
        )


@jax.jit
def _projected(
    contour: Contour, position: Float[Array, "S m"], first: Float[Array, ""]
) -> Float[Array, " S"]:
    """Arc length of every sample [m], from that of the first.

    Each is sought around the one before plus the chord between them: no branch jumps.
    """

    def advance(arc, samples):
        before, here = samples
        chord = jnp.linalg.norm(here - before)
        arc = contour.nearest(here, arc + chord, chord)
        return arc, arc

    first = jnp.asarray(first, position.dtype)
    _, later = jax.lax.scan(advance, first, (position[:-1], position[1:]))
    return jnp.concatenate([first[None], later])


def _sampled(contour: Contour, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and tangent as `Contour` gives them, in NumPy.

    Nothing is compiled for a path that is sampled once.
    """
    length = float(contour.length)
    inside = np.mod(arc, length) if contour.closed else np.clip(arc, 0.0, length)
    starts = np.asarray(contour.start)[np.asarray(contour.mask)]
    index = np.searchsorted(starts, inside, side="right") - 1
    piece = jax.tree.map(lambda rows: np.asarray(rows)[index], contour.pieces)
    position, velocity, _ = piece.jet(inside - piece.start)
    beyond = 0.0 if contour.closed else arc - inside
    tangent = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    return position + np.reshape(beyond, (-1, 1)) * velocity, tangent


class _Samples(NamedTuple):
    """Arrays of a reference over its S samples, on the host."""

    position: np.ndarray
    tangent: np.ndarray
    arc: np.ndarray
    mask: np.ndarray


def _reference(samples: _Samples, contour: Contour, dt: float, preview: int, increment):
    count = len(samples.position)
    steps = count - preview
    if preview < 0 or steps < 1:
        raise ValueError(
            f"preview: {count} samples leave no control step for a preview of {preview}"
        )
    samples = samples._replace(mask=samples.mask & (np.arange(count) < steps))
    arrays = jax.device_put((*samples, np.asarray(increment)))
    return Reference(*arrays, contour, positive("dt", dt), steps)


def __dir__() -> list[str]:
    return __all__
