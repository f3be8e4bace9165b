"""Feed laws against closed forms, and what they refuse."""

from pathlib import Path

import jax
import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.pieces import Piece
from jcontour.geometry.toolpaths import read_gcode
from jcontour.motion.feed_laws import SharpTurnError, constant_feed, trapezoidal

PARTS = Path(__file__).parents[3] / "jcontour" / "app" / "jobs" / "toolpaths"
DT = 0.5e-3
LINE = contours.line([0.0, 0.0], [0.03, 0.04])  # 50 mm


def duration(arc) -> float:
    """Number of samples times dt: the true duration is up to one sample shorter."""
    return (arc.size - 1) * DT


# constant feed


@pytest.mark.parametrize(
    ("feed", "samples"), [(0.05, 2001), (0.1, 1001), (0.07, 1429), (0.0499, 2005), (100.0, 2)]
)
def test_constant_feed_is_exact(feed, samples):
    arc = constant_feed(LINE, feed, DT)
    np.testing.assert_array_equal(arc[:-1], np.arange(samples - 1) * (feed * DT))
    np.testing.assert_allclose(arc[-1], min((samples - 1) * feed * DT, 0.05), rtol=1e-12)
    assert 0.05 - arc[-1] < feed * DT and arc[-1] <= 0.05


@pytest.mark.parametrize("steps", [1, 3, 7, 1000, 123457])
def test_whole_number_of_samples_reaches_the_end(steps):
    for feed in np.random.default_rng(steps).uniform(0.001, 1.0, 20):
        line = contours.line([0.0, 0.0], [steps * feed * DT, 0.0])
        arc = constant_feed(line, feed, DT)
        assert arc.size == steps + 1
        np.testing.assert_allclose(arc[-1], float(line.length), rtol=1e-12)


def test_constant_feed_by_piece_adds_up():
    path = contours.polyline([[0, 0], [0.02, 0], [0.02, 0.01], [0.05, 0.01]])
    feed = np.array([0.04, 0.01, 0.06])
    arc = constant_feed(path, feed, DT)
    assert duration(arc) == pytest.approx(0.5 + 1.0 + 0.5, abs=1e-9)
    np.testing.assert_allclose(
        arc[[0, 1000, 2000, 3000, 4000]], [0, 0.02, 0.025, 0.03, 0.06], atol=1e-12
    )
    np.testing.assert_allclose(np.diff(arc)[[5, 1500, 3500]], feed * DT, rtol=1e-9)
    np.testing.assert_allclose(
        constant_feed(path, np.full(3, 0.04), DT), constant_feed(path, 0.04, DT)
    )


def test_padding_counts_for_nothing():
    path = contours.polyline([[0, 0], [0.02, 0], [0.02, 0.01]])
    padded = jax.tree.map(
        lambda rows: np.asarray(rows)[0],
        contours.stack([path, contours.polygon([[0, 0], [1, 0], [1, 1], [0, 1]])]),
    )
    feed = [0.04, 0.01]
    np.testing.assert_array_equal(constant_feed(padded, feed, DT), constant_feed(path, feed, DT))
    np.testing.assert_array_equal(
        trapezoidal(padded, feed, DT, 2.0), trapezoidal(path, feed, DT, 2.0)
    )


# trapezoids in closed form


def trapezoid(length, speed, acceleration, time):
    """Rest to rest on a line: position at the given times and the duration."""
    speed = min(speed, np.sqrt(length * acceleration))
    ramp = speed / acceleration
    total = length / speed + ramp
    rest = np.clip(total - time, 0, None)
    arc = np.where(time < ramp, 0.5 * acceleration * time**2, speed * (time - 0.5 * ramp))
    return np.where(rest < ramp, length - 0.5 * acceleration * rest**2, arc), total


@pytest.mark.parametrize(
    ("feed", "acceleration"), [(0.05, 2.0), (0.1, 0.5), (0.33, 2.0), (5.0, 2.0), (0.001, 40.0)]
)
def test_line_is_a_trapezoid_or_a_triangle(feed, acceleration):
    arc = trapezoidal(LINE, feed, DT, acceleration)
    expected, total = trapezoid(0.05, feed, acceleration, np.arange(arc.size) * DT)
    np.testing.assert_allclose(arc, expected, atol=1e-13)
    assert arc[0] == 0 and arc[-1] == float(LINE.length)
    assert duration(arc) - DT < total <= duration(arc) + 1e-9


def test_cutting_a_line_in_two_changes_nothing():
    two = contours.polyline([[0, 0], [0.011, 0], [0.05, 0]])
    np.testing.assert_allclose(
        trapezoidal(two, 0.1, DT, 2.0),
        trapezoidal(contours.line([0, 0], [0.05, 0]), 0.1, DT, 2.0),
        atol=1e-13,
    )


def test_axis_limits_on_a_line():
    """The line has the direction (0.6, 0.8)."""
    arc = trapezoidal(LINE, 1.0, DT, 10.0, axis_speed=[0.3, 0.04], axis_acceleration=[0.3, 10.0])
    np.testing.assert_allclose(
        arc, trapezoid(0.05, 0.05, 0.5, np.arange(arc.size) * DT)[0], atol=1e-13
    )
    arc = trapezoidal(LINE, 0.02, DT, 1.0, axis_speed=1.0, axis_acceleration=0.4)
    np.testing.assert_allclose(
        arc, trapezoid(0.05, 0.02, 0.5, np.arange(arc.size) * DT)[0], atol=1e-13
    )


def test_feed_by_piece():
    """0.1 m/s, then 0.02 m/s with the change before the joint, then 0.1 m/s again."""
    path = contours.polyline([[0, 0], [0.02, 0], [0.03, 0], [0.05, 0]])
    arc = trapezoidal(path, [0.1, 0.02, 0.1], DT, 2.0)
    fast = 0.1 / 2.0 + 0.08 / 2.0 + (0.02 - (0.1**2 + 0.1**2 - 0.02**2) / 4.0) / 0.1
    assert duration(arc) == pytest.approx(2 * fast + 0.01 / 0.02, abs=DT)
    inside = (arc[:-1] >= 0.02) & (arc[1:] <= 0.03)
    np.testing.assert_allclose(np.diff(arc)[inside], 0.02 * DT, rtol=1e-9)


@pytest.mark.parametrize("turned", [0.1, 0.5, np.pi / 2, 2.0, 3.0])
def test_corner_speed_is_the_junction_deviation_rule(turned):
    """Two legs of 50 mm; each lasts as long as a run from rest to the corner's speed."""
    acceleration, deviation, feed = 2.0, 5e-6, 0.05
    path = contours.polyline([[-0.05, 0], [0, 0], [0.05 * np.cos(turned), 0.05 * np.sin(turned)]])
    arc = trapezoidal(path, feed, DT, acceleration, junction_deviation=deviation)
    sin_half = np.sin((np.pi - turned) / 2)
    corner = min(feed, np.sqrt(acceleration * deviation * sin_half / (1 - sin_half)))
    leg = (
        feed / acceleration
        + (feed - corner) / acceleration
        + (0.05 - (2 * feed**2 - corner**2) / (2 * acceleration)) / feed
    )
    assert duration(arc) - DT - 1e-9 < 2 * leg <= duration(arc) + 1e-9
    radius = (
        deviation * sin_half / (1 - sin_half)
    )  # of the arc tangent to both sides, `deviation` away from the corner: v^2 = A radius
    assert radius / sin_half - radius == pytest.approx(deviation)


def test_corner_speed_keeps_the_limit_of_the_axis_along_the_bisector():
    """A right angle whose bisector is y: its rule with the acceleration of that axis alone."""
    acceleration, along_y, deviation, feed = 2.0, 0.5, 5e-6, 0.01
    path = contours.polyline([[-0.04, -0.04], [0, 0], [0.04, -0.04]])
    arc = trapezoidal(
        path, feed, 1e-5, acceleration, None, [10.0, along_y], junction_deviation=deviation
    )
    sin_half = np.sqrt(0.5)
    slowest = np.diff(arc)[np.abs(arc[1:] - np.hypot(0.04, 0.04)) < 1e-4].min() / 1e-5
    expected = np.sqrt(along_y * deviation * sin_half / (1 - sin_half))
    assert slowest == pytest.approx(expected, rel=5e-3)


def test_a_bend_is_passed_at_the_curvature_of_its_end_where_it_is_greatest():
    """y = c x^3 leads into a line: v^2 = A / (6 c x) there, though the bend before is less."""
    acceleration, c, width = 1.0, 150.0, 10e-3
    slope = 3 * c * width**2
    polynomial = np.zeros((3, 6, 2))
    polynomial[0, 0], polynomial[0, 1] = [-0.1, 0], [1, 0]
    polynomial[1, 1], polynomial[1, 3] = [1, 0], [0, c]
    polynomial[2, 0] = [width, c * width**3]
    polynomial[2, 1] = np.array([1, slope]) / np.hypot(1, slope)
    none = np.zeros((3, 2)), np.zeros((3, 2)), np.zeros(3), np.zeros(3)
    path = contours.from_pieces(Piece(polynomial, *none, np.array([0.1, width, 0.1])))
    arc = trapezoidal(path, 1.0, 1e-4, acceleration, junction_deviation=1.0)
    there = np.abs(arc[1:] - 0.1 - width) < 1e-4
    curvature = 6 * c * width / (1 + slope**2) ** 1.5
    assert np.diff(arc)[there].mean() / 1e-4 == pytest.approx(
        np.sqrt(acceleration / curvature), rel=5e-3
    )


def test_a_slight_bend_between_two_stops_takes_as_long_as_a_line():
    """It turns by less than one step's angle: a triangle of speed, with its peak at a node."""
    radius, turn = 1.0, 0.02
    path = contours.arc([0.0, 0.0], [0.0, radius], turn)
    arc = trapezoidal(path, 1.0, DT, 2.0)
    assert duration(arc) == pytest.approx(2 * np.sqrt(radius * turn / 2.0), abs=DT)


def test_no_junction_deviation_stops_at_corners_but_not_at_tangent_joints():
    square = contours.polyline([[0, 0], [0.01, 0], [0.02, 0], [0.02, 0.02]])
    arc = trapezoidal(square, 0.05, DT, 2.0, junction_deviation=0.0)
    leg = trapezoid(0.02, 0.05, 2.0, np.zeros(1))[1]
    assert duration(arc) - DT - 1e-9 < 2 * leg <= duration(arc) + 1e-9


def test_circle_is_limited_by_the_centripetal_acceleration():
    radius, acceleration = 0.005, 2.0
    arc = trapezoidal(contours.circle(radius), 1.0, DT, acceleration)
    speed = np.sqrt(acceleration * radius)
    total = trapezoid(2 * np.pi * radius, speed, acceleration, np.zeros(1))[1]
    assert duration(arc) == pytest.approx(total, abs=DT + 2e-3 * total)
    assert np.diff(arc).max() / DT == pytest.approx(speed, rel=1e-6)


def test_two_full_circles_in_opposite_directions_stop_between():
    """Tangents are opposite at the joint: the machine stands there."""
    path = contours.chain([contours.circle(0.005), contours.circle(0.005, clockwise=True)])
    arc = trapezoidal(path, 0.05, DT, 2.0)
    half = np.searchsorted(arc, float(path.length) / 2)
    assert (
        np.diff(arc)[half - 1 : half + 1].max() / DT < 1.5 * 2.0 * DT
    )  # at most 1.5 samples after the stop


# errors


@pytest.mark.parametrize(
    "law", [constant_feed, lambda contour, feed, dt: trapezoidal(contour, feed, dt, 2.0)]
)
@pytest.mark.parametrize(
    ("feed", "dt", "message"),
    [
        (0.0, DT, "feed"),
        (np.nan, DT, "feed"),
        ([0.1, 0.1], DT, "feed: needs one number or one for each of the 1 pieces"),
        (0.1, 0.0, "dt"),
        (0.1, [DT], "dt"),
        (1e-12, DT, "samples"),
    ],
)
def test_bad_numbers(any_type, law, feed, dt, message):
    with pytest.raises(ValueError, match=message):
        law(LINE, feed, dt)


def test_less_than_one_sample():
    with pytest.raises(ValueError, match="within one sample"):
        constant_feed(LINE, 101.0, DT)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"acceleration": 0.0}, "acceleration"),
        ({"axis_speed": [0.1, 0.0]}, "axis_speed"),
        ({"axis_speed": [0.1, 0.1, 0.1]}, "axis_speed"),
        ({"axis_acceleration": -1.0}, "axis_acceleration"),
        ({"junction_deviation": -1e-6}, "junction_deviation"),
    ],
)
def test_bad_limits(limits, message):
    with pytest.raises(ValueError, match=message):
        trapezoidal(LINE, 0.1, DT, **{"acceleration": 2.0, **limits})


def test_stacks_are_refused():
    with pytest.raises(ValueError, match="stack"):
        constant_feed(contours.stack([LINE, LINE]), 0.1, DT)
    with pytest.raises(ValueError, match="stack"):
        trapezoidal(contours.stack([LINE, LINE]), 0.1, DT, 2.0)


def test_rapid_moves_need_a_feed():
    toolpath = read_gcode(PARTS / "bracket.ngc")
    with pytest.raises(ValueError, match="rapid moves have none"):
        constant_feed(toolpath.contour, toolpath.feed, DT)


def test_rests_part_a_run_in_two():
    """In the corner, and at a joint on a line; the parts are those of runs of their own."""
    points = 1e-3 * np.array([[0, 0], [30, 0], [30, 15], [30, 40]])
    limits = {"dt": DT, "acceleration": 2.0}
    rest = np.array([100 * DT, np.nan, 50 * DT])
    whole = trapezoidal(contours.polyline(points), 0.05, rest=rest, **limits)
    alone = [
        trapezoidal(contours.polyline(part), 0.05, **limits) for part in (points[:2], points[1:])
    ]
    first = 0.6 + 0.05 / 2.0  # [s] of 30 mm
    held = np.isclose(whole, 30e-3, rtol=0, atol=1e-12)
    assert abs(held.sum() - 101) <= 1
    assert whole.size - 1 == np.ceil((first + 0.8 + 0.05 / 2.0) / DT - 1e-6) + 150
    np.testing.assert_allclose(whole[: alone[0].size - 1], alone[0][:-1], atol=1e-12)
    np.testing.assert_allclose(whole[-51:], 70e-3, rtol=1e-14)
    stop = np.array([np.nan, 0.0, np.nan])
    stopped = trapezoidal(contours.polyline(points), 0.05, rest=stop, **limits)
    assert np.diff(stopped)[np.argmin(np.abs(stopped - 45e-3))] < 0.05 * DT / 10


def test_a_curve_that_turns_without_end_is_refused_at_once():
    bent, none = np.zeros((1, 6, 2)), np.zeros(1)
    bent[0, 1, 0], bent[0, 2, 1] = 1.0, 1e9  # a parabola whose bend is 2e9 / m
    piece = Piece(bent, np.zeros((1, 2)), np.zeros((1, 2)), none, none, np.ones(1))
    with pytest.raises(SharpTurnError, match="turns too sharply for its length"):
        trapezoidal(contours.from_pieces(piece), 0.05, 1e-3, 1.0)


def test_a_bend_that_hides_between_the_places_that_are_looked_at_first_is_told():
    """It turns back within a micrometre, at 0.3 of its length; looked at are sixteenths."""
    polynomial = np.zeros((1, 6, 2))
    polynomial[0, :3] = [[0.045, 0.0], [-0.3, 9.7e-7], [0.5, 0.0]]  # ten steps at first
    flat, none = np.zeros((1, 2)), np.zeros(1)
    path = contours.from_pieces(Piece(polynomial, flat, flat, none, none, np.ones(1)))
    with pytest.raises(SharpTurnError) as told:
        trapezoidal(path, 0.05, 1e-3, 2.0, 0.1, 2.0)
    assert told.value.piece == 0 and told.value.steps > 5e6
