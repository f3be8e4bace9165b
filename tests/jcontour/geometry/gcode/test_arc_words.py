"""Arcs from words: centres and radii against each other, and what is refused."""

import math

import numpy as np
import pytest

from jcontour.geometry.gcode.arc_words import arcs_of
from jcontour.geometry.gcode.modes import Modes
from jcontour.geometry.toolpath_rules import ToolpathError
from jcontour.geometry.toolpaths import parse_gcode

HERE, THERE = (0.0, 0.0, 0.0), (4e-3, 2e-3, 0.0)  # [m]


def ends_of(values, counter_clockwise=False, here=HERE, there=THERE, **modes):
    return arcs_of(values, here, there, Modes(**modes), counter_clockwise)


@pytest.mark.parametrize("counter_clockwise", [False, True])
@pytest.mark.parametrize("radius", [3.0, -3.0])
def test_a_radius_is_the_centre_that_is_as_far_from_both_ends(radius, counter_clockwise):
    ((end, centre, angle),) = ends_of({"R": radius}, counter_clockwise)
    np.testing.assert_allclose([abs(centre), abs(centre - end)], 3e-3, rtol=1e-12)
    chord = abs(complex(*THERE[:2]))
    short = 2 * math.asin(chord / 6e-3)
    expected = short if radius > 0 else math.tau - short
    assert angle == pytest.approx(expected if counter_clockwise else -expected, rel=1e-12)
    by_centre = ends_of({"I": 1e3 * centre.real, "J": 1e3 * centre.imag}, counter_clockwise)
    np.testing.assert_allclose(by_centre[0], (end, centre, angle), rtol=1e-9)


def test_turns_come_first_and_absolute_centres_are_of_the_program():
    ahead = (1e-3, 0.0, 0.0)
    values = {"I": 1.0, "J": 1.0}
    arcs = ends_of({**values, "P": 3.0}, True, ahead, (2e-3, 1e-3, 0.0), absolute_centres=True)
    angles = [angle for _, _, angle in arcs]
    np.testing.assert_allclose(angles, [math.tau, math.tau, math.pi / 2], rtol=1e-12)
    assert all(centre == pytest.approx(1e-3 + 1e-3j) for _, centre, _ in arcs)


@pytest.mark.parametrize("radius", [134_575.7, 9.9e6])  # [mm]
def test_an_arc_that_is_nearly_straight_bends_by_its_sagitta(traced, radius):
    """Chord^2 / 8 R in the middle, three quarters of it at a quarter."""
    toolpath = parse_gcode(f"F600 G0 X0\nG3 X10 Y0 R{radius}")
    path = traced.points(toolpath, np.array([0.0, 0.25, 0.5, 1.0]))[0]  # [mm]
    np.testing.assert_allclose(path[:, 0], [0, 2.5, 5, 10], atol=1e-6)
    bend = 100 / (8 * radius)
    np.testing.assert_allclose(path[:, 1], -bend * np.array([0, 0.75, 1, 0]), atol=1e-8)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "either a centre"),
        ({"I": 1.0, "R": 2.0}, "either a centre"),
        ({"I": 2.0, "J": 1.0, "K": 1.0}, "K is not in the plane of G17"),
        ({"I": 2.0, "J": 1.0, "P": 0.0}, "P of an arc needs to be 1 to"),
        ({"I": 2.0, "J": 1.0, "P": 1.5}, "P of an arc"),
        ({"R": 1.0}, "radius"),
        ({"R": 1.1e7}, r"the centre of an arc is farther than 10000 m away"),
        ({"R": -1.1e7}, r"the centre of an arc is farther than 10000 m away"),
        ({"J": -1.1e7}, r"the centre of an arc is farther than 10000 m away"),
        ({"I": 1.1e7}, r"the centre of an arc is farther than 10000 m away"),
    ],
)
def test_what_is_no_arc_is_refused(values, message):
    with pytest.raises(ToolpathError, match=message):
        ends_of(values)


def test_an_arc_whose_centre_fits_in_absolute_coordinates_is_told_so():
    here, there = (-40e-3, 50e-3, 0.0), (-30e-3, 40e-3, 0.0)
    with pytest.raises(ToolpathError, match=r"14\.1 mm apart; in absolute .* G90\.1 says so$"):
        ends_of({"I": -40.0, "J": 40.0}, True, here, there)
    assert ends_of({"I": -40.0, "J": 40.0}, True, here, there, absolute_centres=True)
    with pytest.raises(ToolpathError, match="mm apart$"):
        ends_of({"I": -40.0, "J": 30.0}, True, here, there)
