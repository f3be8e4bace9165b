"""Segments of a drawing beside differences of their own points, and what is no segment at all."""

import cmath
import math

import pytest

from jcontour.geometry.drawings.segments import Arc, Curve, Line, is_finite, vanishes

ELLIPSE = Arc(1 + 2j, 3 + 1j, -1 + 2j, 0.4, 1.7)
SEGMENTS = [
    Line(1j, 2 + 3j),
    ELLIPSE,
    ELLIPSE._replace(sweep=-2.9),
    Curve.bezier(0, 1 + 2j, 3 - 1j, 4),
    Curve.bezier(0, 0, 1 + 2j, 4),  # it stands still where it begins
    Curve((1 + 0j, 2j, 3 - 1j), (1.0, 0.5, 0.25)),
    Curve((-1 + 0j, 2j, 3 - 1j), (-1.0, 0.5, 0.25)),
]
NAN = math.nan
INF = math.inf


def place(segment, t):
    """Point at a part of the segment's parameter."""
    if isinstance(segment, Line):
        return (1 - t) * segment.start + t * segment.end
    return segment.at(segment.begin + t * segment.sweep if isinstance(segment, Arc) else t)


@pytest.mark.parametrize("segment", SEGMENTS)
def test_a_segment_heads_to_its_next_point(segment):
    ahead = place(segment, 1e-6) - segment.start
    assert abs(cmath.phase(segment.heading() / ahead)) < 1e-5
    back = place(segment, 1 - 1e-6) - segment.end
    assert abs(cmath.phase(segment.backwards().heading() / back)) < 1e-5


@pytest.mark.parametrize("segment", SEGMENTS)
def test_its_middle_and_its_ends_are_points_of_it(segment):
    places = [segment.start, segment.middle(), segment.end]
    assert places == pytest.approx([place(segment, t) for t in (0.0, 0.5, 1.0)])


def test_a_closed_segment_does_not_vanish_and_a_short_one_does():
    whole = Arc(0, 1e-2, 1e-2j, 0.0, math.tau)
    loop = Curve.bezier(0, 1e-2, 1e-2j, 0)
    assert not vanishes(whole) and not vanishes(loop)
    assert whole.start == whole.end and loop.start == loop.end
    tiny = 1e-12
    assert vanishes(whole._replace(sweep=tiny)) and vanishes(Arc(0, tiny, tiny * 1j, 0, math.tau))
    assert vanishes(Line(1, 1 + tiny)) and vanishes(Curve.bezier(1, 1 + tiny, 1))


@pytest.mark.parametrize("sweep", [1.0, -1.0])
@pytest.mark.parametrize(
    ("first", "second", "round_"),
    [(2, 2j, True), (2, -2j, True), (2, 2.1j, False), (2, 2 * cmath.exp(1.5j), False)],
)
def test_a_circle_has_half_axes_of_one_length_at_right_angles(first, second, round_, sweep):
    assert Arc(1j, first, second, 0.3, sweep).is_circular() == round_


@pytest.mark.parametrize(
    "segment",
    [
        Line(0, complex(0, INF)),
        ELLIPSE._replace(sweep=INF),
        ELLIPSE._replace(first=complex(NAN, 0)),
        Curve((0, INF, 1), (1.0, 0.0, 0.0)),
        Curve((0, 1, 1), (1.0, INF, 0.0)),
        Curve((0, 1, 1), (0.0, 1.0, 0.0)),  # it begins at infinity
        Curve((0, 1, 1), (1.0, 0.0, -1.0)),  # it ends there
    ],
)
def test_what_is_not_finite_is_found(segment):
    assert not is_finite(segment)
    assert all(map(is_finite, SEGMENTS))
