"""A warp of time beside quadrature of its rate, and its derivatives beside each other."""

import numpy as np
import pytest

from jcontour.motion.jerk_limited.conditions import ordinates
from jcontour.motion.jerk_limited.planned_motion import Warp

NODE = np.array([0.0, 0.3, 0.7, 1.5])  # [s]
PLACE, WEIGHT = np.polynomial.legendre.leggauss(40)


def bernstein(square, x):
    """u at the fraction x of a cell with the ordinates (3,)."""
    return square @ [(1 - x) ** 2, 2 * x * (1 - x), x**2]


# curved up, curved down, nearly linear on both sides of where the series begins
BENDS = [0.6, -0.6, 9e-6, -9e-6, 1.8e-6, -1.8e-6, 1e-9, 0.0]


@pytest.mark.parametrize("bend", BENDS)
def test_a_cell_lasts_as_long_as_quadrature_says(bend):
    square = np.array([[0.4, 0.5 - bend / 2, 0.6], [0.6, 0.6 - bend / 2, 0.6], [0.6, 0.55, 0.5]])
    warp = Warp.of(NODE, square)
    for duration, length, row in zip(np.diff(warp.time), np.diff(NODE), square, strict=True):
        by_points = length / 2 * WEIGHT @ (1 / np.sqrt(bernstein(row, 0.5 + 0.5 * PLACE)))
        assert duration == pytest.approx(by_points, rel=2e-14, abs=0.0)


@pytest.mark.parametrize("bend", BENDS)
def test_the_rate_and_its_derivatives_are_those_of_u(bend):
    """(d tau / dt)^2 = u, d2 tau / dt2 = u' / 2, d3 tau / dt3 = u'' / 2 times the rate."""
    square = np.array([[0.4, 0.5 - bend / 2, 0.6]])
    warp = Warp.of(NODE[:2], square)
    time = np.linspace(0.0, warp.time[-1], 7)
    cell, tau, speed, acceleration, jerk = warp.at(time)
    x, length = tau / 0.3, 0.3
    (first, middle, last), second = square[0], square[0] @ [2, -4, 2] / length**2
    slope = 2 * ((middle - first) * (1 - x) + (last - middle) * x) / length
    np.testing.assert_allclose(speed**2, bernstein(square[0], x), rtol=1e-13)
    np.testing.assert_allclose(acceleration, slope / 2, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(jerk, second / 2 * speed, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(warp.reached(cell, tau), time, atol=1e-14)
    assert tau[0] == 0 and tau[-1] == pytest.approx(length, rel=1e-14, abs=0.0)


def test_ordinates_make_a_quadratic_spline_that_is_cut_where_the_motion_stops():
    """u and u' go on from cell to cell; after a stop the spline begins anew."""
    length = np.array([0.2, 0.5, 0.3, 0.4, 0.1, 0.6, 0.2])
    begins = np.array([True, False, False, True, False, False, False])
    unknowns = np.random.default_rng(0).uniform(0.2, 1.0, 7)
    actual = ordinates(length, begins).of(unknowns)
    np.testing.assert_array_equal(actual[:, 1], unknowns)
    starts, ends = (actual[:, 1] - actual[:, 0]) / length, (actual[:, 2] - actual[:, 1]) / length
    on = ~begins[1:]
    np.testing.assert_allclose(actual[1:, 0][on], actual[:-1, 2][on], rtol=1e-14)
    np.testing.assert_allclose(starts[1:][on], ends[:-1][on], rtol=1e-12)
    np.testing.assert_array_equal(actual[[0, 3], 0], unknowns[[0, 3]])
    np.testing.assert_array_equal(actual[[2, 6], 2], unknowns[[2, 6]])
    with pytest.raises(ValueError, match="at least three between stops, received 2"):
        ordinates(length[:5], begins[:5])
