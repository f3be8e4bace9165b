"""Random shapes: closed or long enough, in the size that is asked for, smooth or with corners."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour.app.jobs.sets import random_shapes
from jcontour.app.jobs.sets.random_shapes import KINDS, rounded_polygon
from jcontour.app.jobs.sets.stretches import corner_angles, greatest_curvature
from jcontour.motion.references import along

CLOSED = ("closed_spline", "corners", "fillets")
REACH = {"closed_spline": 1.3, "corners": 1.0, "fillets": 1.0}  # a spline goes beyond its points
TIGHTEST = 30.0  # radii of curvature to the size: none is a cusp
EXAMPLES = st.tuples(st.integers(0, 10_000), st.floats(1e-4, 0.1), st.floats(0.5, 8.0))


def drawn(kind, example):
    seed, size, sizes_long = example
    contour = kind(np.random.default_rng(seed), size, sizes_long * size)
    arc = np.linspace(0.0, 1.0, 400) * float(contour.length)
    return contour, np.asarray(along(contour, arc, 1.0, 0, at_rest=True).position) / size


def test_every_kind_has_a_name_of_its_own():
    names = [kind.__name__ for kind in KINDS]
    assert len(set(names)) == len(KINDS) == 6
    assert set(CLOSED) < set(names)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=8)
@given(example=EXAMPLES)
def test_shapes(kind, example):
    contour, points = drawn(kind, example)
    _, size, sizes_long = example
    name = kind.__name__
    assert np.isfinite(points).all()
    assert bool(contour.closed) == (name in CLOSED)
    if name in CLOSED:
        assert np.linalg.norm(points, axis=1).max() <= REACH[name]
        assert np.linalg.norm(points, axis=1).max() > 0.5
    else:
        assert float(contour.length) >= sizes_long * size * (1 - 1e-9)
        assert np.linalg.norm(points[0]) <= 1.0 + 1e-9
    assert greatest_curvature(contour) * size < TIGHTEST
    turned = corner_angles(contour)
    if name == "corners":
        assert np.sum(turned > 1e-3) >= 3
    else:
        assert turned.max() < 1e-6


@settings(max_examples=5)
@given(example=EXAMPLES)
def test_spirals_turn_to_one_side(example):
    contour, points = drawn(random_shapes.spiral, example)
    chords = np.diff(points[:, 0] + 1j * points[:, 1])
    turns = np.angle(chords[1:] / chords[:-1])
    assert (np.sign(turns) == np.sign(turns[0])).all()
    assert abs(turns.sum()) > 2 * np.pi  # more than a turn
    radius = np.linalg.norm(points[[0, -1]], axis=1)
    assert sorted(radius) == pytest.approx([0.3, 1.0])


@settings(max_examples=5)
@given(seed=st.integers(0, 10_000))
def test_arcs_are_lines_and_circular_arcs(seed):
    contour = random_shapes.arcs(np.random.default_rng(seed), 1e-3, 10e-3)
    assert contour.newton_steps == 0
    assert float(contour.fit_error) == 0


@pytest.mark.parametrize(("rounding", "radius"), [(0.0, 0.0), (0.1, 0.2), (0.4, 0.8)])
def test_rounded_square(rounding, radius):
    """Side 2: an arc of a right angle ends as far from the corner as its radius is."""
    corners = np.array([0.0, 2.0, 2.0 + 2.0j, 2.0j])
    contour = rounded_polygon(corners, np.full(4, rounding))
    assert bool(contour.closed)
    assert float(contour.length) == pytest.approx(8 * (1 - radius) + 2 * np.pi * radius)
    np.testing.assert_allclose(contour.position(0.0), [0.0, 1.0], atol=1e-15)
    middle = radius * (1 - np.sqrt(0.5))  # of the arc, along each axis from the corner
    arc = 1 - radius + 0.25 * np.pi * radius
    np.testing.assert_allclose(contour.position(arc), [middle, middle], atol=1e-12)


def test_each_corner_is_rounded_by_itself_to_either_side():
    """A dart: its inner corner turns the other way."""
    corners = np.array([0.0, 2.0 + 2.0j, 4.0 + 0.0j, 2.0 + 5.0j])
    rounding = np.array([0.0, 0.3, 0.0, 0.2])
    turned = corner_angles(rounded_polygon(corners, rounding))
    assert np.sum(turned > 1e-6) == 2
    inner = 0.3 * np.hypot(2, 2) / np.tan(np.pi / 4)  # half the angle that it turns by
    assert 1 / greatest_curvature(rounded_polygon(corners, rounding * [0, 1, 0, 0])) == (
        pytest.approx(inner)
    )


def test_a_corner_that_does_not_turn_needs_no_arc():
    corners = np.array([0.0, 1.0, 2.0, 2.0 + 2.0j, 2.0j])
    contour = rounded_polygon(corners, np.full(5, 0.2))
    assert bool(contour.closed)
    assert np.sum(np.asarray(contour.rate) > 0) == 4
