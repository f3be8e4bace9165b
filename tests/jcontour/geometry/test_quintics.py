import numpy as np

from jcontour.geometry.quintics import AT_ONCE, fitted

PER_PIECE = 2 + 8 + 7 * 8 + 7  # its ends, its length, and the fit with the lengths up to there


def test_a_piece_that_fits_is_not_fitted_again():
    """A circle in many intervals, one of which is long: the work is that of the pieces made."""
    count, asked = 3 * AT_ONCE, 0

    def circle(t):
        nonlocal asked
        asked += t.size
        point = np.stack([np.cos(t), np.sin(t)], axis=-1)
        turned = np.stack([-np.sin(t), np.cos(t)], axis=-1)
        return point, turned, -point

    knots = np.append(1.5 + np.linspace(0.0, 0.01, count), 4.5)
    fit = fitted("circle", circle, lambda t, frame: frame, knots[:-1], knots[1:], 1e-10)
    assert fit.begin.size > count
    assert (np.diff(fit.begin) > 0).all()
    np.testing.assert_allclose(fit.extent, np.diff(np.append(fit.begin, 4.5)), rtol=1e-9)
    np.testing.assert_allclose(fit.polynomial[:, 0], circle(fit.begin)[0], atol=1e-15)
    assert fit.error < 1e-10
    assert asked < 1.01 * (2 * fit.begin.size - count) * (PER_PIECE + 8)
