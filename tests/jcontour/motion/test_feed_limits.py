"""Limits of motions under a feed law, seen from outside: by differences and on a fine grid."""

from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour.geometry import contours
from jcontour.geometry.toolpaths import read_gcode
from jcontour.motion.feed_laws import trapezoidal

PARTS = Path(__file__).parents[3] / "jcontour" / "app" / "jobs" / "toolpaths"
DT = 0.5e-3


def duration(arc) -> float:
    """Number of samples times dt: the true duration is up to one sample shorter."""
    return (arc.size - 1) * DT


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


@settings(deadline=None, max_examples=30)
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
