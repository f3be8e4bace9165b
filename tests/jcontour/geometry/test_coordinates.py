"""Bad input from users is tested on each constructor too, in test_contours.py."""

import numpy as np
import pytest

from jcontour.geometry.coordinates import distinct_points, finite, number, positive, vector


def test_numbers_become_float64():
    assert number("n", 3) == 3.0 and isinstance(number("n", np.float32(0.5)), float)
    assert vector("v", [1, 2]).dtype == finite("f", [[1], [2]]).dtype == np.float64
    assert vector("v", (7,), axes=(1,)).tolist() == [7.0]


def test_repeated_points_go_and_returns_stay():
    points = [(0, 0), (0, 0), (1, 0), (1, 1e-20), (0, 0)]
    assert distinct_points("p", points, least=2).tolist() == [[0, 0], [1, 0], [0, 0]]


def test_far_from_the_origin_a_step_of_rounding_has_no_direction():
    """A step needs more than four units in the last place of the largest coordinate, 2 m."""
    last_place = 2.0**-52
    near = [(1.0, 0.0), (1.0 + 4 * last_place, 0.0), (2.0, 0.0)]
    far = [(1.0, 0.0), (1.0 + 16 * last_place, 0.0), (2.0, 0.0)]
    assert len(distinct_points("p", near, least=2)) == 2
    assert len(distinct_points("p", far, least=2)) == 3


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: positive("a", 0.0), "a: needs to be above zero, received 0.0"),
        (lambda: positive("a", 1e-100), "above zero"),
        (lambda: number("a", [1.0]), r"a: needs one number, received shape \(1,\)"),
        (lambda: number("a", "x"), "a: needs numbers in a regular array, received 'x'"),
        (lambda: finite("a", [1.0, 1e100]), "below 1e\\+100"),
        (lambda: finite("a", [[1.0], [1.0, 2.0]]), "regular"),
        (lambda: vector("a", [1.0]), r"shape \(2,\) or \(3,\), received shape \(1,\)"),
        (lambda: vector("a", [[1.0, 2.0]]), r"received shape \(1, 2\)"),
        (lambda: distinct_points("a", [1.0, 2.0], least=1), r"received shape \(2,\)"),
        (lambda: distinct_points("a", np.eye(4), least=1), r"\(n, 3\), received shape \(4, 4\)"),
        (lambda: distinct_points("a", [(0, 0), (1, 1), (0, 0)], least=3), "received 2"),
    ],
)
def test_bad_numbers_are_refused_in_one_line(any_type, make, says):
    with pytest.raises(ValueError, match=says):
        make()
    assert positive("a", np.nextafter(1e-100, 1)) > 0
