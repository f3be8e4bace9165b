"""Places and derivatives along pieces, against those of the pieces themselves and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.along_pieces import jet, moved
from jcontour.geometry.contour import unpadded
from jcontour.motion.blending import blended

SQUARE = contours.polygon([(0, 0), (20e-3, 0), (20e-3, 20e-3), (0, 20e-3)])
PATHS = {
    "lines": SQUARE,
    "lines and arcs": contours.chain(
        [contours.line([0.0, 0.0], [0.02, 0.0]), contours.arc([0.02, 0.0], [0.02, 0.01], np.pi)]
    ),
    "quintics": blended(SQUARE, 10e-6).path,
    "in three axes": contours.polyline([[0.0, 0.0, 0.0], [0.01, 0.02, 0.03], [0.0, 0.0, 0.05]]),
}


@pytest.mark.parametrize("shape", [(5, 7), (1,), (16,), (0,)])
@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_jets_are_those_of_the_pieces(path, shape):
    pieces = unpadded(path)
    random = np.random.default_rng(0)
    piece = random.integers(0, pieces.extent.size, shape)
    s = random.uniform(0, 1, shape) * pieces.extent[piece]
    on = jax.tree.map(lambda rows: rows[piece], pieces)
    place, velocity, bend = on.jet(s)
    actual = jet(pieces, piece, s)
    bends = bend + 0 * velocity
    _, third = jax.jvp(lambda s: on.jet(s)[2] + 0 * velocity, (jnp.array(s),), (jnp.ones(shape),))
    expected = (place, velocity, bends, np.asarray(third))
    for one, other in zip(actual, expected, strict=True):
        assert one.shape == velocity.shape
        scale = np.abs(other).max(initial=0.0)
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * scale)


def test_axes_move_as_differences_say():
    """On an arc, along s = 1 mm + 2 mm t - 3 mm t^2 + 5 mm t^3."""
    pieces = unpadded(contours.arc([0.02, 0.0], [0.0, 0.0], np.pi))
    law = np.polynomial.Polynomial([1e-3, 2e-3, -3e-3, 5e-3])
    time, step = 0.7, 1e-3
    one = np.zeros(1, int)
    motion = np.array([[law.deriv(k)(time)] if k else [law(time)] for k in range(4)])
    _, speed, acceleration, jerk = moved(pieces, one, motion)[:, 0]
    before, at, after = (
        moved(pieces, one, np.array([[law.deriv(k)(t)] if k else [law(t)] for k in range(4)]))[:, 0]
        for t in (time - step, time, time + step)
    )
    for k, actual in enumerate((speed, acceleration, jerk)):
        np.testing.assert_allclose((after[k] - before[k]) / (2 * step), actual, rtol=1e-4)
    assert np.linalg.norm(at[0]) == pytest.approx(0.02)
