"""Arcs from words against each other; stops of programs whose stops are known."""

import math

import numpy as np
import pytest

from jcontour.geometry.gcode.modes import Modes
from jcontour.geometry.gcode.moves import Stop, arcs_of, ignored_words, stop_summary, stops_in_cuts
from jcontour.geometry.gcode.programs import interpreted
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


HEAD = "G21 G90 G17 F3000\n"


def stops_of(program: str, axes: int = 2) -> list[Stop]:
    machine = interpreted(program.split("\n"), axes, None)
    return stops_in_cuts(machine.tracer.stops, machine.moves)


def test_time_of_z_alone_is_told_apart():
    """3 mm at 600 and 2 mm at 120 mm/min, and a rapid move; the last one leaves the work."""
    stops = stops_of("F600 G1 X1\nG1 Z-3\nX2\nG0 Z0\nG1 X3\nG1 Z-2 F120\nX4\nG0 Z9\nM5")
    assert [stop.besides for stop in stops][::2] == [0.3, 1.0]
    assert math.isnan(stops[1].besides)
    told = "Z alone takes 1.3 s at its feed; 1 rapid move of Z takes no time"
    assert stop_summary(stops) == f"3 stops: Z 3 times from line 2; {told}"
    two = stop_summary([stops[1], stops[1]])
    assert two == "2 stops: Z 2 times from line 4; 2 rapid moves of Z take no time"


def test_no_more_than_six_reasons_are_told():
    stops = [Stop(k, HERE, 0.0, k, f"M{k}") for k in range(1, 10)]
    assert stop_summary(stops).startswith("9 stops: M1 at line 1, M2 at line 2,")
    assert stop_summary(stops).endswith("M6 at line 6, 3 more reasons")
    assert stop_summary([]) == ""


def test_words_that_stop_are_not_ignored():
    stops = [Stop(1, HERE, 0.0, 3, "M5 M9"), Stop(2, HERE, 0.0, 4, "G43")]
    assert ignored_words({"M5", "M8", "G43", "S"}, stops) == ("M8", "S")


def test_exact_path_is_told_once():
    told = stop_summary(stops_of("F600 G61 G1 X1\nX2 Y1\nX3\nG61.1 X4\nM0 X5\nX6"))
    exact = "G61.1 from line 4: stops after every move; G61 from line 1: stops in corners"
    assert told == f"1 stop: M0 at line 5; {exact}"


def test_dwells_are_rests_at_the_ends_of_pieces():
    """Those before the first cut are none, two at one place add up."""
    toolpath = parse_gcode(
        HEAD + "G4 P9\nG0 X1 Y1\nG4 P9\nG1 X4 Y5\nG4 P1\nG1 Z-1\nG4 P.5\nG0 X4 Y6\nG1 X5\nG4 P0"
    )
    np.testing.assert_array_equal(toolpath.rest, [1.5, np.nan, 0.0])
    assert toolpath.ignored == ()


def test_exact_path_stops_in_corners_and_exact_stop_everywhere():
    """A line, its own half circle with a smooth joint, a corner, and a line in two parts."""
    moves = "G1 X4\nG3 Y2 J1\nG1 X3 Y5\nX2 Y8\nX0"
    free = parse_gcode(HEAD + moves).rest
    np.testing.assert_array_equal(free, np.full(5, np.nan))
    corners = parse_gcode(HEAD + "G61 " + moves).rest
    np.testing.assert_array_equal(corners, [np.nan, 0, np.nan, 0, 0])
    np.testing.assert_array_equal(parse_gcode(HEAD + "G61.1 " + moves).rest, np.zeros(5))


def test_exact_path_passes_turns_that_hardly_take_acceleration():
    """0.29 degrees is 0.00499 of a turn, 0.3 degrees 0.0052; LinuxCNC passes up to about 0.005."""
    for turn, rest in ((0.00499, np.nan), (0.0052, 0.0)):
        program = HEAD + f"G61 G1 X10\nX{10 + 10 * np.cos(turn)} Y{10 * np.sin(turn)}"
        np.testing.assert_array_equal(parse_gcode(program).rest, [rest, 0.0])


def test_stops_of_the_projection():
    """Z alone between two cuts; the time of a dwell there is kept."""
    program = HEAD + "G1 X4\nZ-1\nX5\nM5\nX6\nG4 P2\nM3\nX7"
    np.testing.assert_array_equal(parse_gcode(program).rest, [0, 0, 2, np.nan])
    np.testing.assert_array_equal(parse_gcode(program, "XYZ").rest, [np.nan, np.nan, 0, 2, np.nan])


def test_z_alone_takes_its_time_at_its_feed():
    """3 mm at 600 and 1 mm at 60 mm/min at one place; rapid moves and those behind the last cut."""
    program = HEAD + "F600 G1 X4\nZ-3\nG4 P2\nZ-4 F60\nX5\nG0 Z9\nX6\nG1 Z8.5 F300\nX7\nZ0"
    path = parse_gcode(program)
    np.testing.assert_allclose(path.z_alone, [1.3, 0.0, 0.1, 0.0], rtol=1e-12)
    np.testing.assert_array_equal(path.rest, [2, 0, 0, np.nan])
    np.testing.assert_array_equal(parse_gcode(program, "XYZ").z_alone, np.zeros(9))


def test_dwells_behind_the_last_cut_are_left_out():
    """On two axes, too, where Z has left it; a dwell at its very end is kept."""
    program = HEAD + "G1 X4\nG4 P2\nG0 Z5\nG4 P1\nM30"
    for axes in ("XY", "XYZ"):
        np.testing.assert_array_equal(parse_gcode(program, axes).rest, [2.0])
