"""Distance to a contour in the lanes of a GPU: `Contour.nearest`, number by number.

It takes lines and circular arcs alone, whose nearest point is a closed form.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jcontour.kernels.arithmetic import dot
from jcontour.kernels.gpu.lanes import Operand, Rows


class LaneContour(NamedTuple):
    """Numbers of a contour as lanes read them.

    Attributes:
        polynomial: base and slope of every piece, P x 2 x m rows; the fields below are those of
            `Contour`.
        cosine: P x m rows.
        sine: P x m rows.
        rate: P rows.
        start: P rows.
        extent: P rows.
        filled: pieces that are no padding.
        length: of the whole.
        closed: whether the end meets the start.
        axes: m.
        pieces: P, padding included.
        turns: whether any piece is an arc.
    """

    polynomial: Rows
    cosine: Rows
    sine: Rows
    rate: Rows
    start: Rows
    extent: Rows
    filled: Int[Array, " L"]
    length: Array
    closed: Bool[Array, " L"]
    axes: int
    pieces: int
    turns: bool

    @classmethod
    def read(cls, rows: list[Rows], axes: int, pieces: int, turns: bool) -> "LaneContour":
        """Contour from the rows of `contour_rows`."""
        closed, filled, *parts = rows
        last = pieces - 1  # padding starts at the end
        length = parts[-2].fixed(last) + parts[-1].fixed(last)
        filled = filled.fixed(0).astype(jnp.int32)
        return cls(*parts, filled, length, closed.fixed(0) > 0, axes, pieces, turns)

    def within(self, arc):
        """Arc length taken into the contour [m]."""
        wrapped = arc - self.length * jnp.floor(arc / self.length)
        wrapped = jnp.where(wrapped >= self.length, 0.0, wrapped)
        return jnp.where(self.closed, wrapped, jnp.clip(arc, 0.0, self.length))

    def piece_at(self, inside) -> Int[Array, " L"]:
        """Number of the last piece that begins at an arc length or before, by halving."""
        found = jnp.zeros_like(inside, jnp.int32)
        for bit in reversed(range((self.pieces - 1).bit_length())):
            later = jnp.minimum(found + 2**bit, self.filled - 1)
            found = jnp.where(self.start.fixed(later) <= inside, later, found)
        return found

    def square(self, point: list, arc, reach):
        """Squared distance [m^2] of a point to what lies within `reach` of an arc length.

        Without reach it is that to the contour's point at `arc`.
        """
        begin, end = self._window(self.within(arc), reach)
        inside = self.within(begin)
        first, lap = self.piece_at(inside), begin - inside

        def walk(state):
            k, least, _ = state
            again = first + k >= self.filled  # a window is a lap at most
            piece = jnp.where(again, first + k - self.filled, first + k)
            extent = self.extent.fixed(piece)
            start = self.start.fixed(piece) + jnp.where(again, lap + self.length, lap)
            low = jnp.clip(begin - start, 0.0, extent)
            square = self._foot(piece, point, low, jnp.clip(end - start, low, extent))
            better = (start < end) & (square < least)
            least = jnp.where((k == 0) | better, square, least)
            more = jnp.max(jnp.where(start + extent < end, 1, 0)) > 0
            return k + 1, least, more

        state = jnp.int32(0), jnp.zeros_like(begin), jnp.bool_(True)
        return jax.lax.while_loop(lambda state: state[-1], walk, state)[1]

    def _window(self, arc, reach):
        """Ends of the window around an arc length [m]."""
        reach = jnp.minimum(reach, jnp.where(self.closed, 0.5 * self.length, self.length))
        begin, end = arc - reach, arc + reach
        begin = jnp.where(self.closed, begin, jnp.maximum(begin, 0.0))
        return begin, jnp.where(self.closed, end, jnp.minimum(end, self.length))

    def _foot(self, k, point: list, low, high):
        """Squared distance [m^2] of a point to an interval of piece k: `Piece.foot`."""
        base = self._vector(self.polynomial, 2 * k)
        slope = self._vector(self.polynomial, 2 * k + 1)
        offset = [y - b for y, b in zip(point, base, strict=True)]
        speed = _dot(slope, slope)
        s = jnp.clip(_dot(offset, slope) / jnp.where(speed > 0, speed, 1.0), low, high)
        if not self.turns:
            return squared([y - t * s for y, t in zip(offset, slope, strict=True)])
        cosine, sine = self._vector(self.cosine, k), self._vector(self.sine, k)
        rate = self.rate.fixed(k)
        turning, whole = rate > 0, jnp.where(rate > 0, rate, 1.0)
        first = jnp.arctan2(_dot(offset, sine), _dot(offset, cosine)) / whole
        period = 2.0 * jnp.pi / whole
        # of all turns the one next to the middle of the interval
        turn = first + period * jnp.floor((0.5 * (low + high) - first) / period + 0.5)
        s = jnp.where(turning, jnp.clip(turn, low, high), s)
        cos, sin = jnp.cos(rate * s), jnp.sin(rate * s)
        parts = zip(offset, slope, cosine, sine, strict=True)
        return squared([y - t * s - (a * cos + b * sin) for y, t, a, b in parts])

    def _vector(self, rows: Rows, k) -> list:
        return [rows.fixed(k * self.axes + a) for a in range(self.axes)]


def contour_rows(contour: Any) -> list[Operand]:
    """Rows of a `Contour` of operands, as `LaneContour.read` takes them."""
    filled = Operand(jnp.sum(contour.mask.array, axis=0), contour.mask.axes)
    # lines and arcs have no higher powers
    straight = Operand(contour.polynomial.array[:, :2], contour.polynomial.axes)
    waves = contour.cosine, contour.sine, contour.rate
    return [contour.closed, filled, straight, *waves, contour.start, contour.extent]


def squared(vector: list):
    """Square of a vector's length."""
    return _dot(vector, vector)


def _dot(a: list, b: list):
    return dot(zip(a, b, strict=True))
