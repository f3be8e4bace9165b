"""Polytopes against enumerated corners and sampled points; invariance at every corner."""

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from jcontour.sets.invariant_polytopes import Polytope, box, control_invariant
from jcontour.sets.responses import DisturbedModel

CORNERS = np.linspace(0, 2 * np.pi, 41)
AROUND = np.stack([np.cos(CORNERS), np.sin(CORNERS)], axis=1)


def random_polytope(generator, dimension, rows):
    H, around = generator.normal(size=(rows, dimension)), box(np.full(dimension, 3.0))
    return Polytope(H, generator.uniform(0.3, 1, rows)).intersection(around)


def enumerated(actual):
    """All corners, from every choice of as many rows as there are coordinates."""
    points = []
    for rows in map(list, combinations(range(len(actual.h)), actual.H.shape[1])):
        if abs(np.linalg.det(actual.H[rows])) > 1e-9:
            point = np.linalg.solve(actual.H[rows], actual.h[rows])
            if (actual.H @ point <= actual.h + 1e-9).all():
                points.append(point)
    return np.array(points)


def support(points, rows):
    return (points @ rows.T).max(axis=0)


@pytest.fixture(params=[0, 1, 2])
def generator(request):
    return np.random.default_rng(request.param)


def test_corners_are_those_of_every_choice_of_rows(generator):
    actual, rows = random_polytope(generator, 3, 6), generator.normal(size=(50, 3))
    np.testing.assert_allclose(support(actual.corners, rows), support(enumerated(actual), rows))
    assert (actual.H @ actual.middle < actual.h).all()


def test_reduction_keeps_the_set_and_every_row_that_is_left_counts(generator):
    whole = random_polytope(generator, 2, 12)
    actual = whole.reduced()
    assert len(actual.h) < len(whole.h)
    points = generator.uniform(-3, 3, size=(2000, 2))
    inside = [(points @ one.H.T <= one.h).all(axis=1) for one in (actual, whole)]
    np.testing.assert_array_equal(*inside)
    assert len(actual.h) == len(np.unique(np.round(enumerated(actual), 9), axis=0))  # in the plane


def test_repeated_rows_are_one():
    square = box([1.0, 2.0])
    assert len(Polytope(np.tile(square.H, (3, 1)), np.tile(square.h, 3)).reduced().h) == 4


def test_the_shadow_is_that_of_the_corners(generator):
    actual = random_polytope(generator, 3, 5)
    angles = np.linspace(0, 2 * np.pi, 9)
    rows = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shadow = actual.shadow(2)
    np.testing.assert_allclose(np.linalg.norm(shadow.H, axis=1), 1.0)
    wanted = support(enumerated(actual)[:, :2], rows)
    np.testing.assert_allclose(support(shadow.corners, rows), wanted)


def test_the_shadow_of_a_cube_is_a_square_of_four_rows():
    assert len(box([1.0, 2.0, 3.0]).shadow(2).h) == 4
    assert len(box([1.0, 2.0, 3.0, 4.0]).shadow(3).h) == 6


def test_inclusion_and_emptiness():
    small, large = box([1.0, 1.0]), box([1.0, 2.0])
    assert small.within(large) and not large.within(small) and large.within(small, 1.0 + 1e-9)
    nothing = Polytope(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([-1.0, -1.0]))
    assert nothing.middle is None and small.middle is not None
    with pytest.raises(ValueError, match="it is empty"):
        nothing.reduced()


def test_a_set_without_an_end_is_refused():
    half = Polytope(np.array([[1.0, 0.0]]), np.ones(1))
    with pytest.raises(ValueError, match="needs to be bounded"):
        half.reduced()


@pytest.mark.parametrize("magnitudes", [[-1.0, 1.0], [np.inf, 1.0], [np.nan], [], 2.0, [[1.0]]])
def test_magnitudes_of_a_box_are_numbers_above_zero(magnitudes):
    with pytest.raises(ValueError, match="^magnitudes: needs one finite number above zero"):
        box(magnitudes)


@pytest.fixture(scope="module")
def pushed():
    """A mass on a slide, |x| <= 1, |v| <= 1, |u| <= 1, sampled every 0.4 s."""
    dt = 0.4
    return DisturbedModel.of([[1, dt], [0, 1]], [dt**2 / 2, dt], [0.02, 0.1])


def test_algorithm_1_gives_a_control_invariant_set(pushed):
    """Every vertex has one control that keeps both disturbed states inside."""
    actual = control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=1e-2)
    H, h = actual.polytope
    for x in actual.polytope.corners:
        rows = np.concatenate([H @ pushed.B, [[1.0], [-1.0]]])
        room = h - H @ pushed.A @ x - np.abs(H @ pushed.E).sum(axis=1)
        answer = linprog([0.0], rows, np.append(room, [1.0, 1.0]), bounds=(None, None))
        assert answer.status == 0


def test_algorithm_1_tends_to_the_largest_set(pushed):
    """With a smaller margin the set grows; no set has to grow beyond what is allowed."""
    margins = (1e-2, 1e-3, 1e-4)
    actual = [control_invariant(pushed, box([1.0, 1.0]), np.ones(1), one) for one in margins]
    sizes = [support(one.polytope.corners, AROUND) for one in actual]
    assert (np.diff(sizes, axis=0) >= -1e-9).all()
    assert actual[-1].polytope.within(box([1.0, 1.0]), 1e-9)


def test_too_large_a_disturbance_leaves_nothing(pushed):
    strong = pushed._replace(E=np.array([[0.0], [1.5]]))
    assert control_invariant(strong, box([1.0, 1.0]), np.array([1.0]), margin=1e-3) is None


def test_bad_input_of_the_algorithm_is_named(pushed):
    with pytest.raises(ValueError, match="margin: needs to be above zero"):
        control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=0.0)
    with pytest.raises(ValueError, match="most_steps: no end after 1 steps"):
        control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=1e-6, most_steps=1)
