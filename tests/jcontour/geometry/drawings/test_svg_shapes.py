"""Lengths and transforms of SVG against what the standard says of each."""

import math

import pytest

from jcontour.geometry.drawings.svg_shapes import (
    PX,
    Element,
    length,
    numbers,
    path_strokes,
    transform,
)
from jcontour.geometry.toolpath_rules import ToolpathError


def element(**attributes):
    return Element("g", 3, attributes)


@pytest.mark.parametrize(
    "inch", ["96", "96px", "72pt", "6pc", "1in", "25.4mm", "2.54cm", "101.6Q", " 1e0 in "]
)
def test_an_inch_is_as_long_in_every_unit(inch):
    assert PX * length(element(width=inch), "width") == pytest.approx(25.4e-3, rel=1e-15)
    assert length(element(width=f"-{inch.strip()}"), "width") == pytest.approx(-96, rel=1e-15)


def test_a_part_of_the_whole_and_what_is_not_given():
    assert length(element(width="-12.5%"), "width", whole=40.0) == -5.0
    assert length(element(width="auto"), "width", 7.0) == length(element(), "width", 7.0) == 7.0


COS, SIN, TAN = (f(math.radians(30)) for f in (math.cos, math.sin, math.tan))


@pytest.mark.parametrize(
    ("words", "expected"),  # where (2, 1) comes to
    [
        ("translate(3)", (5, 1)),
        ("translate(3,4)", (5, 5)),
        ("scale(3)", (6, 3)),
        ("scale(3 -4)", (6, -4)),
        ("rotate(30)", (2 * COS - SIN, 2 * SIN + COS)),
        ("rotate(30, 1, 5)", (1 + COS + 4 * SIN, 5 + SIN - 4 * COS)),
        ("skewX(30)", (2 + TAN, 1)),
        ("skewY(30)", (2, 1 + 2 * TAN)),
        ("matrix(1 2 3 4 5 6)", (2 * 1 + 3 + 5, 2 * 2 + 4 + 6)),
        ("translate(1, 0) scale(2), rotate(90)", (-1, 4)),  # the last one first
    ],
)
def test_a_transform_moves_a_point(words, expected):
    moved = transform(element(transform=words)).point(2 + 1j)
    assert (moved.real, moved.imag) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    "words", ["rotate(1e400)", "translate(0 1e400)", "skewX(1e400)", "matrix(1 2)", "spin(3)"]
)
def test_a_transform_that_is_none_is_refused_with_its_line(words):
    with pytest.raises(ToolpathError, match="^line 3: transform cannot be read from"):
        transform(element(transform=words))


def test_a_length_and_a_list_need_numbers_that_are_finite():
    for width in ("1e400", "1e400mm", "1e307in", "1e400%"):
        with pytest.raises(ToolpathError, match="^line 3: the number '1e.*' is too large$"):
            length(element(width=width), "width", whole=40.0)
    with pytest.raises(ToolpathError, match="^line 3: the number '1e999' is too large$"):
        numbers(element(points="1,2 1e999,3"), "points")


def test_a_smooth_curve_goes_on_from_one_of_its_own_kind_only():
    """SVG 2, 9.3.6 and 9.3.7: after another kind the control point is the current point."""
    (stroke,) = path_strokes("M0 0C1 2 3 2 4 0T8 4T12 0S16 4 20 0", 1)
    quadratic, following, cubic = stroke[1:]
    assert quadratic.middle() == pytest.approx(0.75 * 4 + 0.25 * (8 + 4j))
    assert following.middle() == pytest.approx(0.25 * (8 + 4j) + 0.5 * (12 + 8j) + 0.25 * 12)
    assert cubic.middle() == pytest.approx((4 * 12 + 3 * (16 + 4j) + 20) / 8)
