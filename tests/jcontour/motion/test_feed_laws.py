"""Feed laws against closed forms, differences and a second integration of the same limits."""

from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour.geometry import contours
from jcontour.geometry.toolpaths import read_gcode
from jcontour.motion.feed_laws import constant_feed, trapezoidal

PARTS = Path(__file__).parents[3] / "experiments" / "jobs" / "toolpaths"
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
        lambda rows: rows[0],
        contours.stack([path, contours.polygon([[0, 0], [1, 0], [1, 1], [0, 1]])]),
    )
    feed = [0.04, 0.01, np.nan, np.nan]
    np.testing.assert_array_equal(
        constant_feed(padded, feed, DT), constant_feed(path, feed[:2], DT)
    )
    np.testing.assert_array_equal(
        trapezoidal(padded, feed, DT, 2.0), trapezoidal(path, feed[:2], DT, 2.0)
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


# the limits, seen from outside


def differences(contour, arc):
    """Speed, velocity, acceleration along the path and acceleration vector.

    On the host, since every shape would compile anew.
    """
    pieces = jax.tree.map(np.asarray, contour.pieces)
    index = np.searchsorted(pieces.start, arc, side="right") - 1
    position = jax.tree.map(lambda rows: rows[index], pieces).jet(arc - pieces.start[index])[0]
    velocity = np.diff(position, axis=0) / DT
    return np.diff(arc) / DT, velocity, np.diff(arc, 2) / DT**2, np.diff(velocity, axis=0) / DT


def at_corner(contour, arc, most=1e-6):
    """Second differences across a joint at which the direction turns by more than `most` rad."""
    start = np.asarray(contour.start)[1:]
    pieces = jax.tree.map(np.asarray, contour.pieces)
    before, after = pieces.jet(pieces.extent)[1][:-1], pieces.jet(0 * pieces.extent)[1][1:]
    corners = start[np.linalg.norm(before - after, axis=1) > most]
    first, last = (
        np.searchsorted(corners, arc[:-2], side="left"),
        np.searchsorted(corners, arc[2:], side="right"),
    )
    return last > first


@pytest.mark.parametrize("part", ["bracket", "cam"])
@pytest.mark.parametrize("axes", ["XY", "XYZ"])
@pytest.mark.parametrize(
    ("axis_speed", "axis_acceleration"),
    [(None, None), (0.04, None), (None, 1.0), ([0.03, 0.06, 0.01], [0.7, 1.5, 3.0])],
)
def test_parts_keep_to_the_limits(part, axes, axis_speed, axis_acceleration):
    toolpath = read_gcode(PARTS / f"{part}.ngc", axes)
    contour, m = toolpath.contour, len(axes)
    axis_speed, axis_acceleration = (
        limit[:m] if isinstance(limit, list) else limit for limit in (axis_speed, axis_acceleration)
    )
    feed = np.where(toolpath.rapid, 0.1, toolpath.feed)
    arc = trapezoidal(contour, feed, DT, 2.0, axis_speed, axis_acceleration)
    speed, velocity, acceleration, vector = differences(contour, arc)
    assert (speed >= 0).all() and arc[0] == 0 and arc[-1] == float(contour.length)
    assert speed.max() <= feed.max() * (1 + 1e-9) and np.abs(acceleration).max() <= 2.0 * (1 + 1e-6)
    on_piece = np.minimum(
        *(
            feed[np.searchsorted(np.asarray(contour.start), s, side="right") - 1]
            for s in (arc[:-1], arc[1:])
        )
    )
    same_piece = np.diff(np.searchsorted(np.asarray(contour.start), arc, side="right")) == 0
    assert (speed <= on_piece * (1 + 1e-9))[same_piece].all()
    smooth = ~at_corner(contour, arc, 1e-3)
    small_corners = (
        2 * 2.7e-4 * speed.max() / DT if part == "cam" else 0.0
    )  # its joints turn by up to 2.7e-4 rad, here within one sample
    across = vector - acceleration[:, None] * velocity[1:] / np.linalg.norm(
        velocity[1:], axis=1, keepdims=True
    )
    assert np.linalg.norm(across, axis=1)[smooth].max() <= 2.0 * (1 + 2e-2) + small_corners
    if axis_speed is not None:
        assert (np.abs(velocity) <= np.array(axis_speed) * (1 + 1e-6)).all()
    if axis_acceleration is not None:
        assert (
            np.abs(vector)[smooth] <= np.array(axis_acceleration) * (1 + 2e-3) + small_corners
        ).all()


def test_axis_limits_on_a_circle_are_used_and_kept():
    circle = contours.circle(0.005)
    arc = trapezoidal(circle, 1.0, DT, 50.0, axis_speed=[0.08, 0.05], axis_acceleration=[1.0, 1.5])
    _, velocity, _, vector = differences(circle, arc)
    assert (
        np.abs(velocity[:, 1]).max() == pytest.approx(0.05, rel=5e-3)
        and np.abs(velocity).max() <= 0.08
    )
    for axis, limit in enumerate([1.0, 1.5]):
        assert 0.97 * limit < np.abs(vector[:, axis]).max() <= limit * (1 + 1e-3)


@pytest.mark.parametrize("part", ["bracket", "cam"])
def test_duration_agrees_with_a_fine_grid(part):
    """The same limits integrated anew, 2 um apart.

    Speed ceilings are from the curvature and tangents of the contour.
    """
    toolpath = read_gcode(PARTS / f"{part}.ngc")
    contour, acceleration, deviation = toolpath.contour, 2.0, 5e-6
    feed = np.where(toolpath.rapid, 0.1, toolpath.feed)
    ends = np.append(np.asarray(contour.start), float(contour.length))
    s = np.unique(np.concatenate([np.arange(0, ends[-1], 2e-6), ends]))
    ceiling = np.full(s.size, np.inf)
    bends = np.asarray(
        contour.curvature(0.5 * (ends[:-1] + ends[1:]))
    )  # lines and arcs: one curvature each
    cosines = np.sum(
        np.asarray(contour.tangent(ends - 1e-10)) * np.asarray(contour.tangent(ends + 1e-10)),
        axis=1,
    )
    for i, (first, last, bend, cosine) in enumerate(
        zip(ends[:-1], ends[1:], bends, cosines[:-1], strict=True)
    ):
        inside = slice(*np.searchsorted(s, [first, last]) + [0, 1])
        ceiling[inside] = np.minimum(
            ceiling[inside], min(feed[i] ** 2, acceleration / bend if bend else np.inf)
        )
        if i:
            sine_half = np.sqrt((1 + np.clip(cosine, -1, 1)) / 2)
            corner = (
                np.inf
                if sine_half > 1 - 1e-9
                else acceleration * deviation * sine_half / (1 - sine_half)
            )
            ceiling[inside.start] = min(ceiling[inside.start], corner)
    ceiling[[0, -1]] = 0.0
    for order in (range(1, s.size), range(s.size - 2, -1, -1)):
        for k in order:
            j = k - 1 if order.step > 0 else k + 1
            ceiling[k] = min(ceiling[k], ceiling[j] + 2 * acceleration * abs(s[k] - s[j]))
    speed = np.sqrt(ceiling)
    total = np.sum(2 * np.diff(s) / (speed[1:] + speed[:-1]))
    assert duration(trapezoidal(contour, feed, DT, acceleration)) == pytest.approx(
        total, abs=DT, rel=2e-3
    )


coordinate = st.floats(-0.01, 0.01).map(lambda x: round(x, 5))


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=8, unique=True),
    st.floats(0.005, 0.3),
    st.floats(0.1, 20.0),
    st.floats(0.1, 20.0),
    st.floats(0.005, 0.3),
)
def test_any_polyline_keeps_to_the_limits(
    points, feed, acceleration, axis_acceleration, axis_speed
):
    path = contours.polyline(points)
    arc = trapezoidal(path, feed, DT, acceleration, axis_speed, axis_acceleration)
    speed, velocity, along, vector = differences(path, arc)
    assert arc[0] == 0 and arc[-1] == float(path.length) and (speed >= 0).all()
    assert speed.max() <= feed * (1 + 1e-9) and np.abs(velocity).max() <= axis_speed * (1 + 1e-9)
    assert np.abs(along).max() <= acceleration * (1 + 1e-6)
    straight = ~at_corner(path, arc)
    assert np.abs(vector)[straight].max(initial=0) <= axis_acceleration * (1 + 1e-6)


def test_smooth_fitted_curves():
    for curve in (contours.ellipse(0.01, 0.002), contours.lemniscate(0.01)):
        arc = trapezoidal(curve, 0.3, DT, 2.0, axis_acceleration=1.2)
        _, _, along, vector = differences(curve, arc)
        assert np.abs(along).max() <= 2.0 * (1 + 1e-6) and np.abs(vector).max() <= 1.2 * (1 + 1e-2)


# errors


@pytest.mark.parametrize(
    "law", [constant_feed, lambda contour, feed, dt: trapezoidal(contour, feed, dt, 2.0)]
)
@pytest.mark.parametrize(
    ("feed", "dt", "message"),
    [
        (0.0, DT, "feed"),
        (-1.0, DT, "feed"),
        (np.nan, DT, "feed"),
        (np.inf, DT, "feed"),
        ([0.1, 0.1], DT, "feed: needs one number or one for each of the 1 pieces"),
        (0.1, 0.0, "dt"),
        (0.1, -1.0, "dt"),
        (0.1, np.nan, "dt"),
        (0.1, [DT], "dt"),
        (1e-12, DT, "samples"),
        (0.1, 1e-300, "samples"),
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
        ({"acceleration": np.inf}, "acceleration"),
        ({"axis_speed": [0.1, 0.0]}, "axis_speed"),
        ({"axis_speed": [0.1, 0.1, 0.1]}, "axis_speed"),
        ({"axis_acceleration": -1.0}, "axis_acceleration"),
        ({"axis_acceleration": np.nan}, "axis_acceleration"),
        ({"junction_deviation": -1e-6}, "junction_deviation"),
        ({"junction_deviation": np.nan}, "junction_deviation"),
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
