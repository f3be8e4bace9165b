"""Polytopes against enumerated vertices and sampled points."""

from itertools import combinations

import numpy as np
import pytest

from jcontour.sets.polytopes import Polytope, box, polytope


def random_polytope(generator, dimension, rows):
    H = generator.normal(size=(rows, dimension))
    around = box(np.full(dimension, 3.0))
    return polytope(
        np.concatenate([H, around.H]), np.append(generator.uniform(0.3, 1, rows), around.h)
    )


def vertices(found):
    """All of them, from every choice of as many rows as there are coordinates."""
    n, points = found.dimension, []
    for rows in map(list, combinations(range(len(found.h)), n)):
        if abs(np.linalg.det(found.H[rows])) > 1e-9:
            point = np.linalg.solve(found.H[rows], found.h[rows])
            if found.contains(point, 1e-9):
                points.append(point)
    return np.array(points)


@pytest.fixture(params=[0, 1, 2])
def generator(request):
    return np.random.default_rng(request.param)


def test_supports_are_those_of_the_vertices(generator):
    found, rows = random_polytope(generator, 3, 6), generator.normal(size=(5, 3))
    np.testing.assert_allclose(
        found.support(rows), (rows @ vertices(found).T).max(axis=1), rtol=1e-9
    )


def test_reduction_keeps_the_set_and_every_row_that_is_left_counts(generator):
    whole = random_polytope(generator, 2, 12)
    found = whole.reduced()
    assert len(found.h) < len(whole.h)
    points = generator.uniform(-3, 3, size=(2000, 2))
    np.testing.assert_array_equal(found.contains(points), whole.contains(points))
    assert len(found.h) == len(np.unique(np.round(vertices(found), 9), axis=0))  # in the plane


def test_repeated_rows_are_one():
    H, h = np.tile(box([1.0, 2.0]).H, (3, 1)), np.tile(box([1.0, 2.0]).h, 3)
    assert len(Polytope(H, h).reduced().h) == 4


def test_of_rows_in_one_direction_the_tightest_counts():
    H, h = np.array([[1.0], [1.0], [-1.0], [-1.0], [1.0]]), np.array([3.0, 1.0, 4.0, 2.0, 1.0])
    found = Polytope(H, h).reduced()
    assert sorted(zip(found.H.ravel(), found.h, strict=True)) == [(-1.0, 2.0), (1.0, 1.0)]


def test_a_set_away_from_the_origin_is_within_what_holds_it():
    """-3 <= x <= -2 lies below -1.5, and not below -2.5."""
    interval = polytope([[1.0], [-1.0]], [-2.0, 3.0])
    assert interval.within(polytope([[1.0]], [-1.5]))
    assert not interval.within(polytope([[1.0]], [-2.5]))


def test_projection_is_the_shadow_of_the_vertices(generator):
    found = random_polytope(generator, 3, 5)
    angles = np.linspace(0, 2 * np.pi, 9)
    rows = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shadow = (rows @ vertices(found)[:, :2].T).max(axis=1)
    np.testing.assert_allclose(found.without_last().support(rows), shadow, rtol=1e-9)


def test_erosion_leaves_room_for_every_disturbance(generator):
    found, E = random_polytope(generator, 2, 6), 0.05 * generator.normal(size=(2, 2))
    corners = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) @ E.T
    points = generator.uniform(-2, 2, size=(500, 2))
    by_hand = found.contains(points[:, None] + corners).all(axis=1)
    np.testing.assert_array_equal(found.eroded(E).contains(points), by_hand)


def test_inclusion_and_emptiness():
    small, large = box([1.0, 1.0]), box([1.0, 2.0])
    assert small.within(large) and not large.within(small)
    nothing = polytope([[1.0, 0.0], [-1.0, 0.0]], [-1.0, -1.0])
    assert nothing.empty and nothing.within(small) and not small.empty
    with pytest.raises(ValueError, match="it is empty"):
        nothing.support([[1.0, 0.0]])


def test_directions_without_an_end_are_infinite():
    strip = box([1.0, np.inf])
    assert strip.support([[1.0, 0.0], [0.0, 1.0]]).tolist() == [1.0, np.inf]


def test_bad_rows_are_named():
    with pytest.raises(ValueError, match="need shapes"):
        polytope(np.eye(2), [1.0])
    with pytest.raises(ValueError, match="needs to be finite"):
        polytope([[np.nan, 1.0]], [1.0])
    with pytest.raises(ValueError, match="the set is empty"):
        polytope([[0.0, 0.0], [1.0, 0.0]], [-1.0, 1.0])


@pytest.mark.parametrize("magnitudes", [[-1.0, 1.0], [np.nan, 1.0], [], 2.0, [[1.0]]])
def test_magnitudes_of_a_box_are_numbers_of_at_least_zero(magnitudes):
    with pytest.raises(ValueError, match="^magnitudes: needs one number of at least zero for each"):
        box(magnitudes)


def test_sets_points_and_directions_of_another_dimension_are_refused():
    square = box([1.0, 2.0])
    for ask, words in (
        (lambda: square.contains([0.0, 0.0, 0.0]), r"points: needs shape \(\.\.\., 2\), .* \(3,\)"),
        (lambda: square.contains(0.0), r"points: .* received \(\)"),
        (lambda: square.support([1.0]), r"directions: needs shape \(k, 2\), .* received \(1,\)"),
        (lambda: square.within(box([1.0])), "other: needs the dimension of this set, 2, .* of 1"),
        (lambda: square.intersection(box([1.0])), "other: needs the dimension of this set, 2"),
    ):
        with pytest.raises(ValueError, match=words):
            ask()
