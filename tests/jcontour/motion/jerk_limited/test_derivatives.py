import jax
import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.motion.blending import blended
from jcontour.motion.jerk_limited.derivatives import everywhere, path_derivatives
from jcontour.motion.jerk_limited.joints import unpadded

SQUARE = contours.polygon([(0, 0), (20e-3, 0), (20e-3, 20e-3), (0, 20e-3)])
PATHS = {
    "lines": SQUARE,
    "lines and arcs": contours.chain(
        [contours.line([0.0, 0.0], [0.02, 0.0]), contours.arc([0.02, 0.0], [0.02, 0.01], np.pi)]
    ),
    "quintics": blended(SQUARE, 10e-6).path,
    "in three axes": contours.polyline([[0.0, 0.0, 0.0], [0.01, 0.02, 0.03], [0.0, 0.0, 0.05]]),
}


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_derivatives_are_those_of_the_pieces(path):
    pieces = unpadded(path)
    random = np.random.default_rng(0)
    piece = random.integers(0, pieces.extent.size, (5, 7))
    s = random.uniform(0, 1, piece.shape) * pieces.extent[piece]
    on = jax.tree.map(lambda rows: rows[piece], pieces)
    _, velocity, bend = on.jet(s)
    found = path_derivatives(pieces, piece, s)
    for one, other in zip(found, (velocity, bend + 0 * velocity, on.third(s)), strict=True):
        assert one.shape == velocity.shape
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * np.abs(other).max())


def test_everywhere_is_nine_places_of_every_piece():
    first, _, _ = everywhere(unpadded(SQUARE))
    assert first.shape == (9, 4, 2)
    assert np.allclose(first, [[1, 0], [0, 1], [-1, 0], [0, -1]])
