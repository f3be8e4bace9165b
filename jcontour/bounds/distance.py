"""Distance to the true path, as a bound: where the tool may be, against the geometry itself.

At sample k the tool is at y + a n + b t: y without disturbance, n normal and t tangent to the path
at the point nearest to y, |a| <= nu and |b| <= tau. With p(s) the point of the path nearest to
y + s t, and w = y + s t - p(s) = w_n + w_t t,

    dist <= max over |s| <= tau of sqrt((|w_n| + nu)^2 + w_t^2)
as p(s) is no farther than that from any y + s t + a n. It grows by no more than the tool moves, and
is convex in w. Beside a line it is also at most the largest distance of the corners (+-nu, +-tau)
from that line.
The maximum is taken over short intervals of s. With feet p(a), p(b) of both ends on one piece,
every point between is within the larger of both ends' of the chord between the feet, and the path
within max|p''| (b - a)^2 / 8 of it. Across a corner an interval of length h adds half of h.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.geometry.contour import Contour
from jcontour.motion.references import Reference
from jcontour.simulation.metrics import SEARCH_REACH, contour_error

INTERVALS = 64  # along the tangent; across a corner they add 1/64 of tau


class Frames(NamedTuple):
    """Frames at the points of the path nearest to the undisturbed run."""

    tangent: Float[np.ndarray, "T m"]  # unit vectors along the motion
    normals: Float[np.ndarray, "T m-1 m"]  # orthonormal, one fewer than axes
    error: Float[np.ndarray, " T"]  # distance of the undisturbed run from the path [m]
    lag: Float[np.ndarray, " T"]  # its distance from the sample of the reference [m]

    @property
    def basis(self) -> Float[np.ndarray, "T m m"]:
        """Normals and then the tangent, as rows."""
        return np.concatenate([self.normals, self.tangent[:, None]], axis=1)


def frames_along(reference: Reference, output: Float[Array | np.ndarray, "T m"]) -> Frames:
    """Frames of a run.

    Raises:
        ValueError: the run is away from its contour by more than the contour's size.
    """
    away = np.asarray(output) - np.asarray(reference.position)[: reference.steps]
    lag = np.linalg.norm(away, axis=1)
    if not np.all(lag <= float(reference.contour.size)):
        raise ValueError("the undisturbed run leaves its contour: there is nothing to bound")
    arc = reference.arc[: reference.steps]
    nearest = reference.contour.nearest(jnp.asarray(output), arc, SEARCH_REACH * lag)
    tangent = np.asarray(reference.contour.tangent(nearest))
    error = np.linalg.norm(np.asarray(contour_error(jnp.asarray(output), reference)), axis=1)
    if tangent.shape[1] == 2:
        normals = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)[:, None]
    else:  # the rest of an orthonormal basis
        normals = np.linalg.svd(tangent[:, None, :])[2][:, 1:]
    return Frames(tangent, normals, error, lag)


def distance_bounds(
    reference: Reference,
    output: Float[Array | np.ndarray, "T m"],
    frames: Frames,
    across: Float[np.ndarray, " T"],
    along: Float[np.ndarray, " T"],
    intervals: int = INTERVALS,
) -> Float[np.ndarray, " T"]:
    """Largest distance to the path at every sample [m].

    Args:
        reference: with the true geometry.
        output: y of the undisturbed run [m].
        frames: at that run.
        across: nu, largest deviation in the normal plane [m].
        along: tau, largest deviation along the tangent [m].
        intervals: of s.
    """
    contour, steps = reference.contour, reference.steps
    s = np.linspace(-1.0, 1.0, intervals + 1) * along[:, None]
    points = np.asarray(output)[:, None] + s[..., None] * frames.tangent[:, None]
    lag = np.linalg.norm(points - np.asarray(reference.position)[:steps, None], axis=2)
    around = jnp.asarray(reference.arc)[:steps, None]
    arcs = np.asarray(contour.nearest(points, around, SEARCH_REACH * lag))
    away = points - np.asarray(contour.position(arcs))
    ahead = np.sum(away * frames.tangent[:, None], axis=2)
    beside = np.linalg.norm(away - ahead[..., None] * frames.tangent[:, None], axis=2)
    farthest = np.hypot(beside + across[:, None], ahead)
    most = _between(contour, arcs, farthest, 2 * along / intervals)
    if contour.axes != 2:
        return most
    # the distance to one line is convex: one of the corners of where the tool may be is farthest
    piece = _piece_at(contour, arcs[:, arcs.shape[1] // 2])
    signs = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    moved = signs[:, :1, None] * across[:, None] * frames.normals[:, 0]
    moved = moved + signs[:, 1:, None] * along[:, None] * frames.tangent
    start, direction = np.moveaxis(np.asarray(contour.polynomial)[piece, :2], 1, 0)
    away = np.asarray(output) + moved - start
    s = np.clip(np.sum(away * direction, axis=2), 0.0, np.asarray(contour.extent)[piece])
    farthest = np.linalg.norm(away - s[..., None] * direction, axis=2).max(axis=0)
    straight = _largest_second_derivative(contour)[piece] == 0
    return np.where(straight, np.minimum(most, farthest), most)


def _between(
    contour: Contour, arcs: np.ndarray, farthest: np.ndarray, length: np.ndarray
) -> np.ndarray:
    """Largest distance over all intervals (T,): from that of their ends, and their length."""
    piece = _piece_at(contour, arcs)
    first, last = farthest[:, :-1], farthest[:, 1:]
    moved = np.diff(arcs, axis=1)
    bent = _largest_second_derivative(contour)[piece[:, :-1]] * moved**2 / 8
    on_one = np.maximum(first, last) + bent
    anywhere = (first + last + length[:, None]) / 2
    same = piece[:, :-1] == piece[:, 1:]
    return np.where(same, np.minimum(on_one, anywhere), anywhere).max(axis=1)


def _piece_at(contour: Contour, arcs: np.ndarray) -> np.ndarray:
    starts = np.asarray(contour.start)[np.asarray(contour.mask)]
    return np.clip(np.searchsorted(starts, arcs, side="right") - 1, 0, starts.size - 1)


def _largest_second_derivative(contour: Contour) -> np.ndarray:
    """Bound of |p''(s)| on every piece (P,) [1/m]."""
    powers = np.arange(contour.polynomial.shape[1])
    extent = np.asarray(contour.extent)[:, None]
    sizes = np.linalg.norm(np.asarray(contour.polynomial), axis=2)
    second = powers * (powers - 1) * sizes * extent ** np.maximum(powers - 2, 0)
    waves = np.linalg.norm(np.stack([contour.cosine, contour.sine], axis=1), 2, axis=(1, 2))
    return second.sum(axis=1) + np.asarray(contour.rate) ** 2 * waves
