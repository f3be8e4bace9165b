"""Constructors of contours: what they make, how closely they fit, and what they refuse."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jcontour.geometry.contours import (
    arc,
    chain,
    circle,
    ellipse,
    lemniscate,
    line,
    polygon,
    polyline,
    spline,
    stack,
)


@pytest.mark.parametrize("name", ["ellipse", "lemniscate", "periodic", "spline 3-D"])
def test_fit_error_bounds_the_distance_everywhere(name, shapes):
    contour, curve, _ = shapes.cases()[name]
    position, dense = (
        shapes.along(contour.position, np.linspace(0, float(contour.length), 4000)),
        curve(np.linspace(0, 1, 200_001)),
    )
    _, i = cKDTree(dense).query(position)
    chord = dense[np.minimum(i + 1, len(dense) - 1)] - dense[np.maximum(i - 1, 0)]
    chord /= np.linalg.norm(chord, axis=1, keepdims=True)
    gap = position - dense[i]
    across = np.linalg.norm(gap - np.sum(gap * chord, axis=1, keepdims=True) * chord, axis=1)
    assert 0 < float(contour.fit_error) <= 1e-10
    assert across.max() <= float(contour.fit_error) + 3e-12  # the sagitta between dense points


def test_tolerance_sets_the_number_of_pieces():
    coarse, fine = ellipse(0.06, 0.03, tolerance=1e-6), ellipse(0.06, 0.03)
    assert coarse.rate.size < fine.rate.size and 1e-10 < float(coarse.fit_error) <= 1e-6
    with pytest.raises(ValueError, match="ellipse.*tolerance"):
        ellipse(0.06, 0.03, tolerance=1e-25)


def test_circle_is_one_exact_piece(shapes):
    assert (
        circle(0.03).rate.size == 1
        and circle(0.03).newton_steps == 0
        and circle(0.03).fit_error == 0
    )
    assert float(circle(0.03).size) == pytest.approx(0.06 * np.sqrt(2), rel=1e-14)
    np.testing.assert_allclose(
        shapes.along(shapes.cases()["circle"].contour.curvature, np.linspace(-1, 1, 9)),
        1 / 0.03,
        rtol=1e-13,
    )


def test_several_turns_and_whole_turns_of_an_arc(shapes):
    contour = shapes.cases()["turns"].contour
    total = float(contour.length)
    actual = shapes.nearest(contour, (0.02, 0.001), np.array([0.0, 0.4, 0.8]) * total, 0.2 * total)
    np.testing.assert_allclose(
        actual, 0.01 * (np.arctan2(0.001, 0.02) + 2 * np.pi * np.arange(3)), rtol=1e-12
    )
    assert bool(arc((0.01, 0.0), (0.0, 0.0), 2 * np.pi).closed) and not bool(contour.closed)


def test_repeated_points_are_dropped_and_a_polyline_back_to_its_start_is_closed(shapes):
    repeated = polyline([(0, 0), (0, 0), (0.1, 0), (0.1, 0), (0.1, 0.1), (0.1, 0.1)])
    assert repeated.rate.size == 2 and not bool(repeated.closed)
    assert bool(polyline([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0)]).closed)
    assert polygon([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0)]).rate.size == 3
    assert polygon([(0, 0), (0.1, 0), (0.1, 0.1), (1e-17, 0)]).rate.size == 3
    nearly = spline(np.vstack([shapes.HEART, shapes.HEART[:1] + 1e-17]), closed=True)
    assert bool(nearly.closed) and float(nearly.length) == pytest.approx(
        float(shapes.cases()["periodic"].contour.length), rel=1e-12
    )
    assert float(spline([(0, 0), (0, 0), (0.3, 0.4)]).length) == pytest.approx(0.5, rel=1e-14)


def test_chain_names_the_gap():
    with pytest.raises(
        ValueError,
        match=r"chain: contour 1 ends at \[0.2, 0.0\] but contour 2 starts at .*0.001 m apart",
    ):
        chain([line((0, 0), (0.1, 0)), line((0.1, 0), (0.2, 0)), line((0.2, 0.001), (0.3, 0))])
    joined = chain([line((0, 0), (0.1, 0)), line((0.1, 1e-12), (0.2, 0))])
    assert joined.rate.size == 2
    again = chain(
        [chain([line((0, 0), (0.1, 0)), line((0.1, 0), (0.1, 0.1))]), line((0.1, 0.1), (0, 0))]
    )
    assert again.rate.size == 3 and bool(again.closed)


NAN = float("nan")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: line((0, 0), (0, 0)), "2 distinct points"),
        (lambda: line((0, 0), (0, 1, 2)), "line|regular"),
        (lambda: line((0, 0), (0, NAN)), "finite"),
        (lambda: polyline([(0, 0)]), "2 distinct points"),
        (lambda: polyline([(0, 0), (1e-120, 0)]), "length above zero"),
        (lambda: polyline(np.zeros((3, 4))), r"\(n, 2\) or \(n, 3\), received shape \(3, 4\)"),
        (lambda: circle(0.0), "radius: needs to be above zero, received 0"),
        (lambda: circle(1.0, centre=(0,)), "centre"),
        (lambda: ellipse(0.1, 0.0), "ellipse b"),
        (lambda: ellipse(0.1, 1e-30), "tolerance"),
        (lambda: lemniscate(-0.1), "lemniscate"),
        (lambda: spline([(0, 0), (1, 1)], closed=True), "3 distinct points"),
        (lambda: spline([(0, 0), (0, 1)], tolerance=0.0), "tolerance"),
        (lambda: arc((0, 0), (0, 0), 1.0), "radius"),
        (lambda: arc((1, 0), (0, 0), 0.0), "angle"),
        (lambda: arc((1, 0), (0, 0, 0), 1.0), "same number of axes"),
        (lambda: arc((1, 0), (0, 0), 1.0, rise=0.1), "two axes"),
        (lambda: arc((1, 0), (0, 0), 1.0, normal=(1, 0, 0)), "two axes"),
        (lambda: arc((1, 0, 0), (0, 0, 0), 1.0, normal=(0, 0, 0)), "normal"),
        (lambda: arc((1, 0, 0), (0, 0, 0), 1.0, normal=(1, 0, 1)), "right angles"),
        (lambda: chain([]), "at least one"),
        (lambda: chain([line((0, 0), (0, 1)), line((0, 1, 0), (0, 0, 0))]), "same number of axes"),
        (lambda: chain([stack([circle(0.1)])]), "single contours"),
        (lambda: stack([]), "at least one"),
        (lambda: stack([line((0, 0), (0, 1)), line((0, 1, 0), (0, 0, 0))]), "same number of axes"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_bad_input_is_refused_in_one_line(any_type, make, says):
    with pytest.raises(ValueError, match=says):
        make()
