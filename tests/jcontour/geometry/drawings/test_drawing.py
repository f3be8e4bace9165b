"""Contours from strokes: gaps, directions, branches, doubles, and their order."""

import numpy as np
import pytest

from jcontour.geometry.drawings.drawing import joined, without_doubles
from jcontour.geometry.drawings.segments import Arc, Curve, Drawn, Line
from jcontour.geometry.toolpath_rules import ToolpathError

GAP = 10e-6  # [m]
MM = 1e-3


def strokes(*segments):
    return [[Drawn(segment, number)] for number, segment in enumerate(segments)]


def lines(*corners):
    """A stroke for every pair of corners [mm]."""
    return strokes(*[Line(MM * a, MM * b) for a, b in corners])


def order(actual):
    return [[line for _, line in stroke] for stroke in actual]


def ends(stroke):
    return np.array([(segment.start, segment.end) for segment, _ in stroke]) / MM


def test_a_square_in_no_order():
    actual = joined(lines((0, 1), (0, 1j), (1 + 1j, 1), (1 + 1j, 1j)), GAP)
    assert order(actual) == [[0, 2, 3, 1]]
    np.testing.assert_array_equal(ends(actual[0])[:, 0], [0, 1, 1 + 1j, 1j])


def test_a_contour_is_carried_on_at_both_ends():
    actual = joined(lines((1, 2), (3, 2), (1, 0)), GAP)
    assert order(actual) == [[2, 0, 1]]
    np.testing.assert_array_equal(ends(actual[0]), [[0, 1], [1, 2], [2, 3]])


def test_contours_come_in_the_order_of_the_file():
    actual = joined(lines((9, 8), (0, 1), (2, 1), (7, 8)), GAP)
    assert order(actual) == [[0, 3], [1, 2]]


def test_at_a_branch_it_goes_on_where_it_bends_least():
    actual = joined(lines((0, 1), (1, 1 + 1j), (1, 2 + 0.1j), (1, 1 - 1j)), GAP)
    assert order(actual) == [[0, 2], [3, 1]] or order(actual) == [[0, 2], [1, 3]]


def test_gaps_are_closed_by_moving_ends():
    bent = Arc(MM * (1 + 1j), -0.996j * MM, 0.996 * MM, 0.0, np.pi / 2)
    actual = joined(strokes(Line(0, MM), bent), GAP)
    assert len(actual) == 1
    line, arc = (segment for segment, _ in actual[0])
    assert line.end == pytest.approx(MM) and abs(arc.start - line.end) < 1e-15
    assert abs(arc.end - bent.end) < 1e-15 and arc.is_circular()
    assert len(joined(strokes(Line(0, MM), bent), 1e-6)) == 2


def test_a_gap_beside_a_nearly_whole_circle_is_closed_by_a_line():
    curled = Arc(MM * (2 + 0.004j), -MM, -1j * MM, 0.0, 0.99 * 2 * np.pi)
    actual = joined(strokes(Line(0, MM), curled), GAP)
    assert [type(segment) for segment, _ in actual[0]] == [Line, Line, Arc]
    assert actual[0][2].segment == curled


def test_closing_gaps_around_a_contour():
    actual = joined(lines((0, 1), (1.002, 1 + 1j), (1 + 1.003j, 0.004)), GAP)
    corners = ends(actual[0])
    assert len(actual) == 1
    np.testing.assert_allclose(corners[:, 1], np.roll(corners[:, 0], -1), atol=1e-12)
    assert abs(corners - [[0, 1], [1, 1 + 1j], [1 + 1j, 0]]).max() <= 0.005


def test_what_is_drawn_twice_is_cut_once():
    curve = Curve.bezier(0, MM, MM * (1 + 1j), 2 * MM)
    kept, doubles = without_doubles(
        strokes(Line(0, MM), curve, Line(MM, 0), curve.backwards(), Line(0, 2 * MM))
    )
    assert order(kept) == [[0], [1], [4]] and doubles == 2


def test_far_too_many_ends_in_one_place(monkeypatch):
    monkeypatch.setattr("jcontour.geometry.drawings.drawing.MOST_ENDS", 5)
    with pytest.raises(ToolpathError, match="line 2: more than 5 ends of lines within 10 um"):
        joined(lines(*[(0, 1e-3 * k + 1e-4j) for k in range(1, 9)]), GAP)
