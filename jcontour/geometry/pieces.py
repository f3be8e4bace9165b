"""One piece of a contour, in its own arc length s [m] from 0 to `extent`.

    p(s) = sum_i polynomial[i] s^i + cosine cos(rate s) + sine sin(rate s)

A line is a polynomial of degree 1, a circular arc a constant and the waves, a helix degree 1 and
the waves, a smooth curve a chain of quintic polynomials. The same code serves NumPy arrays
(constructors, on the host) and JAX arrays (everything else); leading axes broadcast.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

Some = Any  # NumPy or JAX array
# local arc length [m] of the nearest point, squared distance to it [m^2]
Foot = tuple[Float[Some, "..."], Float[Some, "..."]]

# of the speed squared: keeps Newton's denominator positive where a valley of the squared distance
# turns into a ridge
FLATTEST_BEND = 1e-3


class Piece(NamedTuple):
    """Pieces along the leading axes; lengths in metres, rate in rad/m.

    The rate of a piece without waves is 0; None: no piece has any.
    """

    polynomial: Float[Some, "... D m"]
    cosine: Float[Some, "... m"]
    sine: Float[Some, "... m"]
    rate: Float[Some, "..."]
    start: Float[Some, "..."]
    extent: Float[Some, "..."]

    @classmethod
    def polynomials(
        cls, polynomial: Float[np.ndarray, "... D m"], extent: Float[np.ndarray, "..."]
    ) -> "Piece":
        """Pieces without waves, of lengths [m]; where each starts is left to the contour."""
        still, none = np.zeros_like(polynomial[..., 0, :]), np.zeros_like(extent)
        return cls(polynomial, still, still, none, none, extent)

    def taken(self, index: Any) -> "Piece":
        """Some of the pieces, by what indexes an array."""
        return jax.tree.map(lambda rows: rows[index], self)

    def jet(
        self, s: Float[Some, "..."]
    ) -> tuple[Float[Some, "... m"], Float[Some, "... m"], Float[Some, "... #m"]]:
        """Position [m], velocity dp/ds [1] and acceleration d2p/ds2 [1/m] at the arc length s [m].

        The acceleration of lines has one zero for all axes.
        """
        t = s[..., None]
        position = velocity = half_acceleration = 0.0 * t
        # Horner's rule and its two derivatives
        for i in reversed(range(self.polynomial.shape[-2])):
            half_acceleration = half_acceleration * t + velocity
            velocity = velocity * t + position
            position = position * t + self.polynomial[..., i, :]
        acceleration = 2.0 * half_acceleration
        if self.rate is None:
            return position, velocity, acceleration
        xp = s.__array_namespace__()  # numpy or jax.numpy
        rate = self.rate[..., None]
        cos, sin = xp.cos(rate * t), xp.sin(rate * t)
        wave = self.cosine * cos + self.sine * sin
        slope = self.sine * cos - self.cosine * sin
        return position + wave, velocity + rate * slope, acceleration - rate**2 * wave

    def foot(
        self, point: Float[Some, "... m"], low: Float[Some, "..."], high: Float[Some, "..."]
    ) -> Foot:
        """Nearest point of the interval in closed form.

        It is exact on lines (projection) and on circular arcs (polar angle).
        """
        s = self._projection(point, low, high)
        if self.rate is not None:
            first, period = self._angle_fits(point)
            turn = first + period * jnp.round((s - first) / period)
            s = jnp.where(self.rate > 0, jnp.clip(turn, low, high), s)
        return s, self._squared_distance(point, s)

    def refined_foot(
        self,
        point: Float[Some, "... m"],
        low: Float[Some, "..."],
        high: Float[Some, "..."],
        newton_steps: int,
    ) -> Foot:
        """Nearest point of the interval by Newton's method from two sides and of its ends.

        Polynomials start from both ends. Arcs and helices start where the angle fits, on the two
        turns next to the projection on the axis: from there to the nearest point the slope of the
        squared distance is concave, so that Newton's steps do not overshoot.
        """
        both = jax.tree.map(lambda rows: rows[None], self)  # candidates are on a new axis in front
        least_s, most_s, target = low[None], high[None], point[None]
        ends = jnp.stack([low, high])
        s = ends
        if self.rate is not None:
            first, period = self._angle_fits(point)
            turns = jnp.floor((self._projection(point, low, high) - first) / period)
            below = first + period * turns
            fits = jnp.clip(jnp.stack([below, below + period]), least_s, most_s)
            s = jnp.where(both.rate > 0, fits, s)

        def newton(_, s):
            position, velocity, acceleration = both.jet(s)
            gap = position - target
            speed = _dot(velocity, velocity)
            bend = jnp.abs(speed + _dot(gap, acceleration))
            step = _dot(gap, velocity) / jnp.maximum(bend, FLATTEST_BEND * speed)
            return jnp.clip(s - step, least_s, most_s)

        s = jax.lax.fori_loop(0, newton_steps, newton, s)
        s = jnp.concatenate([s, jnp.broadcast_to(ends, s.shape)])
        square = both._squared_distance(target, s)
        best, least = s[0], square[0]
        for other, its in zip(s[1:], square[1:], strict=True):
            better = (its < least) | ((its == least) & (other < best))
            best, least = jnp.where(better, other, best), jnp.minimum(least, its)
        return best, least

    def _squared_distance(self, point, s):
        gap = point - self.jet(s)[0]
        return _dot(gap, gap)

    def _projection(self, point, low, high):
        """Arc length in [low, high] nearest to the point on the axis of a line or helix."""
        direction = self.polynomial[..., 1, :]
        speed = _dot(direction, direction)
        straight = speed > 0
        along = _dot(point - self.polynomial[..., 0, :], direction)
        along = along / jnp.where(straight, speed, 1.0)
        return jnp.clip(jnp.where(straight, along, 0.5 * (low + high)), low, high)

    def _angle_fits(self, point):
        """Arc length at which the polar angle is the point's, and that of a whole turn."""
        offset = point - self.polynomial[..., 0, :]
        rate = jnp.where(self.rate > 0, self.rate, 1.0)
        angle = jnp.arctan2(_dot(offset, self.sine), _dot(offset, self.cosine))
        return angle / rate, 2.0 * jnp.pi / rate


def _dot(a, b):
    return sum(a[..., i] * b[..., i] for i in range(a.shape[-1]))
