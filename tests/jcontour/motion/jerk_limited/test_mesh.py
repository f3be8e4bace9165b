"""Cells of a path: their times and their number, in closed form."""

import numpy as np

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.jerk_limited import mesh
from jcontour.motion.jerk_limited.limits import AxisLimits

LIMITS = AxisLimits.of(2, acceleration=3.0, jerk=150.0, speed=0.2)
BUILD_UP = 3.0 / 150.0  # [s]


def test_a_cell_is_an_eighth_of_the_time_for_which_jerk_lasts():
    """On the diagonal both axes push, and both have their speed."""
    pieces = unpadded(contours.polyline([[0.0, 0.0], [1e-3, 0.0], [2e-3, 1e-3], [2e-3, 2e-3]]))
    actual = mesh.cell_times(pieces, np.array([1e-3, 1e-3, 0.1]), LIMITS)
    slow = [np.sqrt(1e-3 / 150.0), np.sqrt(1e-3 / (150.0 * np.sqrt(2)))]
    np.testing.assert_allclose(8 * actual, [*slow, BUILD_UP], rtol=1e-12)
    limits = LIMITS._replace(speed=np.full(2, 1e-3))
    actual = mesh.cell_times(pieces, np.full(3, 0.1), limits)
    diagonal = np.sqrt(np.sqrt(2) * 1e-3 / (np.sqrt(2) * 150.0))
    np.testing.assert_allclose(8 * actual, [slow[0], diagonal, slow[0]], rtol=1e-12)


def test_a_slow_stretch_is_launched_on_within_a_short_way():
    """The first stretch is fast at both ends, the second at one of them, the third at none."""
    lasting = np.array([1.0, 1.0, 1.0, 1e-4, 1e-4, 2e-4])
    actual = mesh.launch_lengths(lasting / 8, LIMITS, np.array([0, 0, 1, 1, 2, 2]))
    ramps = 2.0 * np.array([BUILD_UP, 4e-4, 4e-4])
    np.testing.assert_allclose(actual, 150.0 * ramps**3 / 6, rtol=1e-12)


def test_there_are_no_more_cells_than_there_may_be(monkeypatch):
    """Sixteen thousand of a cell's times."""
    circle, limits = contours.circle(10e-3), AxisLimits.of(2, 3.0, 15e3)
    pieces, feed = unpadded(circle), np.full(1, 5.0)
    stops = np.array([0.0, float(circle.length)])
    tick = mesh.cell_times(pieces, feed, limits)
    monkeypatch.setattr(mesh, "MOST_CELLS", 300)
    place, _ = mesh.nodes(circle, pieces, feed, limits, stops, tick)
    assert 250 < place.size <= 301


def test_no_cell_lies_within_rounding_of_a_stop():
    """Samples of the motion that it is made from may come to its end a whole sample too soon."""
    path = contours.arc([3e-3, 0.0], [0.0, 0.0], 3.0)
    pieces, length = unpadded(path), float(path.length)
    for feed in np.geomspace(5e-6, 1e-5, 20):
        tick = mesh.cell_times(pieces, np.full(1, feed), LIMITS)
        place, _ = mesh.nodes(path, pieces, np.full(1, feed), LIMITS, np.array([0, length]), tick)
        assert np.diff(place, append=length).min() > 1e-13 * length
