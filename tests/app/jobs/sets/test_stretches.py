"""Contours moved, cut and measured: against closed forms and the contour's own points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour.app.jobs.entry import ENTRY
from jcontour.app.jobs.job import Pace, at_constant_feed
from jcontour.app.jobs.sets.stretches import (
    angle_between,
    beginning,
    corner_angles,
    corner_feed,
    curve_feed,
    greatest_curvature,
    moved,
    shortened,
)
from jcontour.app.machines.built_in import bridgeport_machine
from jcontour.geometry.contours import arc, circle, ellipse, lemniscate, line, polygon, polyline
from jcontour.motion.feed_laws import trapezoidal
from jcontour.motion.references import along

SQUARE = polygon([[0.0, 0.0], [2e-3, 0.0], [2e-3, 2e-3], [0.0, 2e-3]])
CONTOURS = {
    "circle": circle(1e-3),
    "ellipse": ellipse(3e-3, 1.5e-3),
    "square": SQUARE,
    "helix": arc([1e-3, 0.0, 0.0], [0.0, 0.0, 0.0], 7.0, rise=2e-3),
}


def points_at(contour, arc):
    """Points [m], by NumPy: nothing is compiled for every shape."""
    return np.asarray(along(contour, arc, 1.0, 0, at_rest=True).position)


@pytest.fixture(scope="module")
def pace():
    return Pace(bridgeport_machine(), None, None)


@pytest.mark.parametrize("name", CONTOURS)
def test_moved_contours_are_the_same_elsewhere(name):
    contour = CONTOURS[name]
    by = np.array([0.3, -0.2, 0.1])[: contour.axes]
    there = moved(contour, by)
    s = np.linspace(0.0, float(contour.length), 57)
    np.testing.assert_allclose(there.position(s), np.asarray(contour.position(s)) + by, atol=1e-15)
    assert bool(there.closed) == bool(contour.closed)
    assert float(there.size) == pytest.approx(float(contour.size))


def test_moved_into_space():
    there = moved(SQUARE, np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(there.position(3e-3), [1.002, 2.001, 3.0], atol=1e-15)


def test_space_does_not_move_into_a_plane():
    with pytest.raises(ValueError, match="needs at least 3 axes, received 2"):
        moved(CONTOURS["helix"], np.zeros(2))


@settings(max_examples=20)
@given(name=st.sampled_from(list(CONTOURS)), part=st.floats(0.01, 0.999))
def test_beginning_is_the_first_stretch(name, part):
    contour = CONTOURS[name]
    length = part * float(contour.length)
    cut = beginning(contour, length)
    assert float(cut.length) == pytest.approx(length, rel=1e-12)
    arc = np.array([0.0, 0.3, 0.7, 1.0 - 1e-12]) * length
    np.testing.assert_allclose(points_at(cut, arc), points_at(contour, arc), atol=1e-14)
    assert not bool(cut.closed)


def test_beginning_of_more_than_the_whole_is_the_whole():
    assert beginning(SQUARE, 8e-3) is SQUARE


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan])
def test_beginning_has_a_length(length):
    with pytest.raises(ValueError, match="length: needs to be above zero"):
        beginning(SQUARE, length)


@pytest.mark.parametrize(
    ("contour", "curvature"),
    [
        (circle(2e-3), 500.0),
        (ellipse(3e-3, 1.5e-3), 3e-3 / 1.5e-3**2),
        (lemniscate(3e-3), 3.0 / 3e-3),
        (line([0.0, 0.0], [1.0, 0.0]), 0.0),
        (SQUARE, 0.0),
    ],
)
def test_greatest_curvature(contour, curvature):
    assert greatest_curvature(contour) == pytest.approx(curvature, rel=1e-6, abs=1e-9)


def test_curve_feed_needs_the_acceleration_and_no_more():
    assert curve_feed(circle(1e-3), 2.5) == pytest.approx(0.05)
    assert curve_feed(SQUARE, 2.5) == np.inf


def test_corners_of_closed_and_open_paths():
    np.testing.assert_allclose(corner_angles(SQUARE), np.full(4, np.pi / 2))
    bent = polyline([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [2.0, -1.0]])
    np.testing.assert_allclose(corner_angles(bent), [np.pi / 4, 3 * np.pi / 4])
    np.testing.assert_allclose(corner_angles(ellipse(3e-3, 1e-3)), 0.0, atol=1e-8)
    assert corner_angles(line([0.0, 0.0], [1.0, 0.0])).size == 0


@given(st.floats(1e-9, np.pi))
def test_angles_are_exact_when_they_are_small(angle):
    found = angle_between(np.array([[2.0, 0.0]]), 3.0 * np.array([[np.cos(angle), np.sin(angle)]]))
    assert found[0] == pytest.approx(angle, rel=1e-7)


@pytest.mark.parametrize("turned", [0.3, np.pi / 2, 2.5])
def test_corner_feed_is_that_of_the_rest_to_rest_feed_law(turned):
    """A long way before and after: the feed law is slowest at the corner, by this rule."""
    bent = polyline([[-0.1, 0.0], [0.0, 0.0], [0.1 * np.cos(turned), 0.1 * np.sin(turned)]])
    feed = corner_feed(bent, 2.0, 1e-4)
    way = trapezoidal(bent, 10.0, 1e-5, 2.0, junction_deviation=1e-4)
    at_corner = int(np.searchsorted(way, 0.1))
    assert (way[at_corner + 1] - way[at_corner]) / 1e-5 == pytest.approx(feed, rel=5e-3)


def test_corner_feed_without_corners():
    assert corner_feed(ellipse(3e-3, 1e-3), 2.0, 1e-4) == np.inf
    assert corner_feed(line([0.0, 0.0], [1.0, 0.0]), 2.0, 1e-4) == np.inf


def test_corner_feed_is_zero_where_the_path_turns_back():
    back = polyline([[0.0, 0.0], [1.0, 0.0], [0.5, 0.0]])
    assert corner_feed(back, 2.0, 1e-4) == pytest.approx(0.0, abs=1e-9)


def test_shortened_runs(pace):
    whole = at_constant_feed("circle", circle(1e-3), pace)
    assert shortened(whole, whole.samples) is whole
    cut = shortened(whole, 120)
    np.testing.assert_array_equal(np.flatnonzero(cut.scored), np.arange(ENTRY, ENTRY + 120))
    np.testing.assert_array_equal(cut.arc, whole.arc[: ENTRY + 120])
    nearly = shortened(whole, whole.samples - 1)  # behind the entry there are no more
    np.testing.assert_array_equal(np.flatnonzero(nearly.scored), np.arange(ENTRY, whole.samples))
