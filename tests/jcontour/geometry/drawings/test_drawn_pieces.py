"""Curves that are hard to fit: handles drawn in, cusps, whole turns; and their measured error."""

import numpy as np
import pytest

from jcontour.geometry.drawings.drawn_pieces import FIT_TOLERANCE, drawn_pieces
from jcontour.geometry.drawings.segments import Arc, Curve, Line

MM = 1e-3


def bezier(*points):
    return Curve.bezier(*[MM * complex(*point) for point in points])


def apart(curve, actual):
    """Largest distance [m] between a curve and its pieces, each seen from the other's points."""
    fractions = np.linspace(0, 1, 33)
    pieces = actual.pieces
    points = np.concatenate(
        [
            pieces._replace(**{name: rows[i] for name, rows in pieces._asdict().items()}).jet(
                fractions * pieces.extent[i]
            )[0]
            for i in range(pieces.extent.size)
        ]
    )
    t = np.linspace(0, 1, 8001)
    true = np.array([curve.at(u) for u in t])
    distances = np.abs((points @ [1, 1j])[:, None] - true)
    # the nearest of the samples is as far along as half a step, not across
    step = np.abs(np.diff(true)).max()
    return np.sqrt(np.maximum(distances.min(axis=1) ** 2 - step**2, 0)).max()


@pytest.mark.parametrize(
    "curve",
    [
        bezier((0, 0), (5, 0), (5, 5), (10, 5)),
        bezier((0, 0), (0, 0), (5, 5), (10, 5)),  # a handle drawn in
        bezier((0, 0), (3, 5), (10, 5), (10, 5)),
        bezier((0, 0), (0, 0), (10, 5), (10, 5)),  # both: a straight line
        bezier((0, 0), (0, 0), (0, 0), (10, 5)),
        bezier((0, 0), (10, 10), (0, 10), (10, 0)),  # a cusp in its middle
        bezier((0, 0), (10, 10), (-0.1, 10), (10, 0)),  # a loop
        bezier((0, 0), (10, 10), (0.01, 10), (10, 0)),  # nearly a cusp
        bezier((0, 0), (12, 0), (-2, 0), (10, 0)),  # straight, to and fro
        bezier((0, 0), (7, 9), (10, 0)),
    ],
)
def test_bezier_curves(curve):
    actual = drawn_pieces([curve])
    assert actual.fit_error <= FIT_TOLERANCE
    assert apart(curve, actual) < 3 * FIT_TOLERANCE
    start, tangent, _ = actual.pieces.jet(np.zeros(actual.pieces.extent.size))
    np.testing.assert_allclose(np.linalg.norm(tangent, axis=-1), 1, atol=1e-9)
    end = actual.pieces.jet(actual.pieces.extent)[0]
    np.testing.assert_allclose(start[1:], end[:-1], atol=1e-14)
    np.testing.assert_allclose([start[0] @ [1, 1j], end[-1] @ [1, 1j]], [curve.start, curve.end])


def test_kinds_stay_in_their_order():
    line, arc = Line(0, MM), Arc(MM * (1 + 1j), -1j * MM, MM, 0.0, np.pi)
    ellipse = Arc(MM * (1 + 4j), -2j * MM, MM, 0.0, np.pi)
    actual = drawn_pieces([line, ellipse, arc, Line(5 * MM, 5 * MM), line])
    assert sorted(set(actual.owner.tolist())) == [0, 1, 2, 4]
    assert (np.diff(actual.owner) >= 0).all()
    assert (actual.pieces.rate > 0).tolist() == (actual.owner == 2).tolist()


def test_a_part_of_an_ellipse_has_pieces_that_meet_where_its_axes_are():
    """Three quarters of it: halves of the whole would meet elsewhere."""
    centre, long, short = MM * (1 + 4j), 20 * MM, -3j * MM
    actual = drawn_pieces([Arc(centre, long, short, 0.0, 1.5 * np.pi)])
    start = actual.pieces.jet(np.zeros(actual.pieces.extent.size))[0] @ [1, 1j]
    for vertex in (centre + long, centre + short, centre - long):
        assert np.abs(start - vertex).min() < 1e-15
