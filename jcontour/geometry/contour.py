"""The contour: a tool path in arc length, as one padded array of pieces.

Contours of different shape therefore batch; see `contours.stack`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from jcontour._arrays import in_words, is_concrete, placed
from jcontour.geometry.pieces import Piece


class Contour(eqx.Module):
    """Path in arc length s [m].

    With s from its own start, each piece is

        p(s) = sum_i polynomial[i] s^i + cosine cos(rate s) + sine sin(rate s)
    Everything works under jit and vmap, over points as well as over stacked contours (then every
    array has a leading axis).

    Attributes:
        polynomial: coefficients [m, 1, 1/m, ...].
        cosine: wave of arcs and helices [m].
        sine: the other wave, a quarter of a turn later [m].
        rate: angle per arc length [rad/m], 0 where there is no wave.
        start: arc length at which the piece begins [m]; padding begins at the end.
        extent: its length [m], 0 for padding.
        mask: False for padding, which follows the pieces.
        closed: whether the end meets the start.
        size: diagonal of the bounding box [m].
        fit_error: measured bound of the distance to the true curve [m]; 0 for lines, arcs and
            helices.
        newton_steps: refinement of the nearest point; 0 when there are only lines and circular
            arcs, whose nearest point is a closed form.
        turns: whether any piece is an arc or a helix; where none is, no sine is computed.
    """

    polynomial: Float[Array, "*stack P 6 m"]
    cosine: Float[Array, "*stack P m"]
    sine: Float[Array, "*stack P m"]
    rate: Float[Array, "*stack P"]
    start: Float[Array, "*stack P"]
    extent: Float[Array, "*stack P"]
    mask: Bool[Array, "*stack P"]
    closed: Bool[Array, "*stack"]
    size: Float[Array, "*stack"]
    fit_error: Float[Array, "*stack"]
    newton_steps: int = eqx.field(static=True, default=0)
    turns: bool = eqx.field(static=True, default=True)

    def __repr__(self) -> str:
        pieces = in_words(self.mask.sum(axis=-1)) if hasattr(self.mask, "sum") else "its"
        length = (
            in_words(self.extent.sum(axis=-1), "mm", 1e3) if hasattr(self.extent, "sum") else "?"
        )
        return f"Contour({pieces} pieces, {length} long)"

    @property
    def axes(self) -> int:
        """Number of axes m: 2 or 3, or 1 for lines."""
        return self.polynomial.shape[-1]

    @property
    def length(self) -> Float[Array, "*stack"]:
        """Total arc length [m]."""
        if not is_concrete(self.start, self.extent):
            return self.start[..., -1] + self.extent[..., -1]  # padding starts at the end
        start, extent = np.asarray(self.start), np.asarray(self.extent)
        return placed(np.asarray(start[..., -1] + extent[..., -1]))

    @jax.jit
    def position(self, arc: Float[ArrayLike, "*batch"]) -> Float[Array, "*batch m"]:
        """Point at arc length `arc` [m].

        A closed contour wraps; an open one goes straight on beyond its ends.
        """
        piece, s, beyond = self._at(jnp.asarray(arc))
        position, velocity, _ = piece.jet(s)
        return position + beyond[..., None] * velocity

    @jax.jit
    def tangent(self, arc: Float[ArrayLike, "*batch"]) -> Float[Array, "*batch m"]:
        """Unit vector along the motion; a corner has the tangent of the piece that begins there."""
        piece, s, _ = self._at(jnp.asarray(arc))
        velocity = piece.jet(s)[1]
        return velocity / jnp.sqrt(jnp.sum(velocity**2, axis=-1, keepdims=True))

    @jax.jit
    def curvature(self, arc: Float[ArrayLike, "*batch"]) -> Float[Array, "*batch"]:
        """Curvature |dt/ds| [1/m], not negative; 0 beyond the ends of an open contour.

        Corners have none.
        """
        square = jnp.sum(self.curvature_vector(arc) ** 2, axis=-1)
        bent = square > 0
        return jnp.where(bent, jnp.sqrt(jnp.where(bent, square, 1.0)), 0.0)

    @jax.jit
    def curvature_vector(self, arc: Float[ArrayLike, "*batch"]) -> Float[Array, "*batch m"]:
        """Curvature vector dt/ds [1/m], towards the centre of the osculating circle.

        It is 0 beyond the ends of an open contour.
        """
        piece, s, beyond = self._at(jnp.asarray(arc))
        _, velocity, acceleration = piece.jet(s)
        speed = jnp.sum(velocity**2, axis=-1, keepdims=True)
        along = jnp.sum(acceleration * velocity, axis=-1, keepdims=True) / speed
        across = acceleration - along * velocity
        return jnp.where(beyond[..., None] == 0, across / speed, 0.0)

    @jax.jit
    def nearest(
        self,
        point: Float[ArrayLike, "*#batch m"],
        arc: Float[ArrayLike, "*#batch"],
        reach: Float[ArrayLike, "*#batch"],
    ) -> Float[Array, "*#batch"]:
        """Arc length s* [m] of the contour point nearest to `point`, within a window.

        The window is |s - arc| <= reach. The window keeps the search on its own branch at a
        self-crossing. It wraps on a closed contour and ends with an open one, into which `arc` is
        taken first; without reach, or for a point that is not finite, the answer is `arc` itself.
        Corners are exact.

        The search is not differentiated and nothing is lost by that: with s* held, |point -
        position(s*)|^2 has the derivative 2 (point - position(s*)), which is exact since s* is
        stationary or the end of a piece or of the window (envelope theorem).
        """
        point, arc, reach = jnp.asarray(point), jnp.asarray(arc), jnp.asarray(reach)
        return jax.lax.stop_gradient(_nearest(*jax.lax.stop_gradient((self, point, arc, reach))))

    @jax.jit
    def nearest_anywhere(self, point: Float[ArrayLike, "*batch m"]) -> Float[Array, "*batch"]:
        """Arc length [m] of the nearest point of the whole contour, by search over all pieces.

        It is NaN for a point that is not finite.
        """
        contour, point = jax.lax.stop_gradient((self, jnp.asarray(point)[..., None, :]))
        batch = tuple(range(point.ndim - 2))
        pieces, mask = jax.tree.map(
            lambda rows: jnp.expand_dims(rows, batch),
            (contour._pieces(jnp.arange(contour.rate.size)), contour.mask),
        )
        low = jnp.zeros(
            jnp.broadcast_shapes(point.shape[:-1], mask.shape),
            jnp.result_type(point, contour.rate),
        )
        s, square = contour._foot(pieces, point, low, low + pieces.extent)
        best = jnp.argmin(jnp.where(mask, square, jnp.inf), axis=-1)[..., None]
        arc = jnp.take_along_axis(pieces.start + s, best, axis=-1)[..., 0]
        return jax.lax.stop_gradient(jnp.where(jnp.isfinite(point).all((-1, -2)), arc, jnp.nan))

    @property
    def pieces(self) -> Piece:
        """All pieces, padding included."""
        return Piece(self.polynomial, self.cosine, self.sine, self.rate, self.start, self.extent)

    def within(self, arc):
        """Arc length taken into the contour [m].

        It is in [0, length) for a closed contour, which wraps, and in [0, length] for an open one.
        """
        length = self.length
        wrapped = arc - length * jnp.floor(arc / length)
        wrapped = jnp.where(wrapped >= length, 0.0, wrapped)  # -1e-20 rounds to a whole lap
        return jnp.where(self.closed, wrapped, jnp.clip(arc, 0.0, length))

    @property
    def _count(self):
        return jnp.sum(self.mask, dtype=jnp.int32)

    def _index(self, inside):
        return jnp.clip(jnp.searchsorted(self.start, inside, side="right") - 1, 0, self._count - 1)

    def _pieces(self, index) -> Piece:
        pieces = self.pieces
        if not self.newton_steps:  # lines and arcs have no higher powers
            pieces = pieces._replace(polynomial=self.polynomial[:, :2])
        if not self.turns:
            pieces = pieces._replace(cosine=None, sine=None, rate=None)
        return jax.tree.map(lambda rows: rows[index], pieces)

    def _at(self, arc):
        """Piece, arc length within it and signed distance beyond the ends of an open contour."""
        inside = self.within(arc)
        piece = self._pieces(self._index(inside))
        return piece, inside - piece.start, jnp.where(self.closed, 0.0, arc - inside)

    def _foot(self, piece, point, low, high):
        if self.newton_steps:
            return piece.refined_foot(point, low, high, self.newton_steps)
        return piece.foot(point, low, high)


def unpadded(contour: Contour) -> Piece:
    """Pieces of one contour in NumPy, without padding.

    Raises:
        ValueError: a stack of contours.
    """
    mask = np.asarray(contour.mask)
    if mask.ndim != 1:
        raise ValueError(f"contour: needs one contour, received a stack of shape {mask.shape[:-1]}")
    return jax.tree.map(lambda rows: np.asarray(rows)[mask], contour.pieces)


def _nearest(contour: Contour, point, arc, reach):
    """Nearest points for `Contour.nearest`, all points in step."""
    dtype = jnp.result_type(contour.start, point, arc, reach)
    shape = jnp.broadcast_shapes(point.shape[:-1], arc.shape, reach.shape)
    arc = jnp.broadcast_to(contour.within(arc).astype(dtype), shape)
    usable = jnp.isfinite(point).all(-1) & jnp.isfinite(arc) & (reach > 0)
    begin, end = _window(contour, arc, reach, usable)
    inside = contour.within(begin)
    first, lap = contour._index(inside), begin - inside  # laps unroll a closed contour
    count = contour._count

    def walk(state):
        k, best, least, _ = state
        again = first + k >= count  # a window is a lap at most
        piece = contour._pieces(jnp.where(again, first + k - count, first + k))
        start = piece.start + jnp.where(again, lap + contour.length, lap)
        low = jnp.clip(begin - start, 0.0, piece.extent)
        high = jnp.clip(end - start, low, piece.extent)
        s, square = contour._foot(piece, point, low, high)
        better = usable & ((k == 0) | (start < end)) & (square < least)
        best = jnp.where(better, start + s, best)
        least = jnp.where(better, square, least)
        more = jnp.any(usable & (start + piece.extent < end))
        return k + 1, best, least, more

    state = (jnp.int32(0), arc, jnp.full(shape, jnp.inf, dtype), jnp.any(usable))
    _, best, _, _ = jax.lax.while_loop(lambda state: state[-1], walk, state)
    return contour.within(best)


def _window(contour: Contour, arc, reach, usable):
    """Ends of the window around every arc length [m]: at most a lap, and within an open contour."""
    length = contour.length
    most = jnp.where(contour.closed, 0.5 * length, length)
    reach = jnp.where(usable, jnp.minimum(reach, most), 0.0)
    begin, end = arc - reach, arc + reach
    begin = jnp.where(contour.closed, begin, jnp.maximum(begin, 0.0))
    end = jnp.where(contour.closed, end, jnp.minimum(end, length))
    return begin, end


POINTS = 2000  # of a contour at least
PARTS = 16  # of every piece at least


def outline(contour: Contour) -> Float[np.ndarray, "K m"]:
    """Points along a single contour [m], in order: the ends of all pieces, and points between.

    The extreme points of circular arcs, and of helices across their axis, are among them.
    """
    pieces = contour.pieces
    cosine, sine, rate, start, extent = (
        np.asarray(rows, float)[np.asarray(contour.mask)] for rows in pieces[1:]
    )
    parts = max(PARTS, -(-POINTS // len(start)))
    arc = start[:, None] + extent[:, None] * np.linspace(0.0, 1.0, parts + 1)
    # extremes of c cos(rate s) + d sin(rate s) are at rate s = atan2(d, c) + k pi
    angle = np.sign(rate)[:, None, None] * np.arctan2(sine, cosine)[..., None]
    turn = np.abs(rate)[:, None, None]
    along = np.mod(angle + [0.0, np.pi], 2 * np.pi) / np.where(turn > 0, turn, 1.0)
    extreme = (start[:, None, None] + along)[(turn > 0) & (along <= extent[:, None, None])]
    whole = np.unique(np.append(arc, extreme))
    # the end of a closed path would be its start
    return np.asarray(contour.position(np.minimum(whole, np.nextafter(whole[-1], 0.0))))
