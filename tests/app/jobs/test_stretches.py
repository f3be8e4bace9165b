"""Contours moved, cut and measured: against closed forms and the contour's own points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.jobs import stretches as module
from jcontour.app.jobs.job import ENTRY, Pace, at_constant_feed, from_file
from jcontour.app.jobs.stretches import (
    WINDOW,
    angle_between,
    beginning,
    between,
    corner_angles,
    curve_feed,
    greatest_curvature,
    moved,
    representatives,
    shortened,
)
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.geometry.contours import arc, circle, ellipse, lemniscate, line, polygon, polyline
from jcontour.motion.references import along

SQUARE = polygon([[0.0, 0.0], [2e-3, 0.0], [2e-3, 2e-3], [0.0, 2e-3]])
CONTOURS = {
    "circle": circle(1e-3),
    "ellipse": ellipse(3e-3, 1.5e-3),
    "square": SQUARE,
    "helix": arc([1e-3, 0.0, 0.0], [0.0, 0.0, 0.0], 7.0, rise=2e-3),
}


def points_at(contour, arc):
    """Points [m], by NumPy: nothing is compiled for every shape."""
    return np.asarray(along(contour, arc, 1.0, 0, at_rest=True).position)


@pytest.fixture(scope="module")
def pace():
    return Pace(bridgeport_machine(), None, None)


@pytest.mark.parametrize("name", CONTOURS)
def test_moved_contours_are_the_same_elsewhere(name):
    contour = CONTOURS[name]
    by = np.array([0.3, -0.2, 0.1])[: contour.axes]
    there = moved(contour, by)
    s = np.linspace(0.0, float(contour.length), 57)
    np.testing.assert_allclose(there.position(s), np.asarray(contour.position(s)) + by, atol=1e-15)
    assert bool(there.closed) == bool(contour.closed)
    assert float(there.size) == pytest.approx(float(contour.size))


def test_moved_into_space():
    there = moved(SQUARE, np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(there.position(3e-3), [1.002, 2.001, 3.0], atol=1e-15)


def test_space_does_not_move_into_a_plane():
    with pytest.raises(ValueError, match="needs at least 3 axes, received 2"):
        moved(CONTOURS["helix"], np.zeros(2))


@settings(max_examples=20)
@given(name=st.sampled_from(list(CONTOURS)), part=st.floats(0.01, 0.999))
def test_beginning_is_the_first_stretch(name, part):
    contour = CONTOURS[name]
    length = part * float(contour.length)
    cut = beginning(contour, length)
    assert float(cut.length) == pytest.approx(length, rel=1e-12)
    arc = np.array([0.0, 0.3, 0.7, 1.0 - 1e-12]) * length
    np.testing.assert_allclose(points_at(cut, arc), points_at(contour, arc), atol=1e-14)
    assert not bool(cut.closed)


def test_beginning_of_more_than_the_whole_is_the_whole():
    assert beginning(SQUARE, 8e-3) is SQUARE


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan])
def test_beginning_has_a_length(length):
    with pytest.raises(ValueError, match="length: needs to be above zero"):
        beginning(SQUARE, length)


@pytest.mark.parametrize(
    ("contour", "curvature"),
    [
        (circle(2e-3), 500.0),
        (ellipse(3e-3, 1.5e-3), 3e-3 / 1.5e-3**2),
        (lemniscate(3e-3), 3.0 / 3e-3),
        (line([0.0, 0.0], [1.0, 0.0]), 0.0),
        (SQUARE, 0.0),
    ],
)
def test_greatest_curvature(contour, curvature):
    assert greatest_curvature(contour) == pytest.approx(curvature, rel=1e-6, abs=1e-9)


def test_curve_feed_needs_the_acceleration_and_no_more():
    assert curve_feed(circle(1e-3), 2.5) == pytest.approx(0.05)
    assert curve_feed(SQUARE, 2.5) == np.inf


def test_corners_of_closed_and_open_paths():
    np.testing.assert_allclose(corner_angles(SQUARE), np.full(4, np.pi / 2))
    bent = polyline([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [2.0, -1.0]])
    np.testing.assert_allclose(corner_angles(bent), [np.pi / 4, 3 * np.pi / 4])
    np.testing.assert_allclose(corner_angles(ellipse(3e-3, 1e-3)), 0.0, atol=1e-8)
    assert corner_angles(line([0.0, 0.0], [1.0, 0.0])).size == 0


@given(st.floats(1e-9, np.pi))
def test_angles_are_exact_when_they_are_small(angle):
    angles = angle_between(np.array([[2.0, 0.0]]), 3.0 * np.array([[np.cos(angle), np.sin(angle)]]))
    assert angles[0] == pytest.approx(angle, rel=1e-7)


def test_shortened_runs(pace):
    whole = at_constant_feed("circle", circle(1e-3), pace)
    assert shortened(whole, whole.samples) is whole
    cut = shortened(whole, 120)
    np.testing.assert_array_equal(np.flatnonzero(cut.scored), np.arange(ENTRY, ENTRY + 120))
    np.testing.assert_array_equal(cut.arc, whole.arc[: ENTRY + 120])
    nearly = shortened(whole, whole.samples - 1)  # behind the entry there are no more
    np.testing.assert_array_equal(np.flatnonzero(nearly.scored), np.arange(ENTRY, whole.samples))


DT = 0.5e-3


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """Long straight lines, and one zigzag of 40 corners in the middle; 12 s at 3 m/min."""
    zigzag = [f"G1 X{150 + 0.5 * k} Y{1.0 if k % 2 else 0.0}" for k in range(1, 41)]
    lines = ["G0 X0 Y0", "G1 X150 Y0 F3000", *zigzag, "G1 X170 Y300", "G1 X400 Y300", "M2"]
    path = tmp_path_factory.mktemp("long") / "part.ngc"
    path.write_text("\n".join(lines) + "\n")
    return from_file(path, Pace(machine_named("bridgeport"), None, None))


def test_stretches_are_samples_of_the_program_in_motion(program):
    stretches = representatives(program, DT)
    assert program.samples > module.LONG and 2 <= len(stretches) <= module.COUNT
    whole = np.asarray(program.reference(DT, 5).position)
    for one in stretches:
        reference = one.reference(DT, 5)
        position = np.asarray(reference.position)[:WINDOW]
        apart = np.linalg.norm(whole[:, None] - position[:1], axis=-1).ravel()
        first = int(np.argmin(apart))
        np.testing.assert_allclose(position, whole[first : first + WINDOW], atol=1e-9)
        assert np.linalg.norm(reference.start_increment) > 0
        assert not one.scored[:ENTRY].any() and one.scored[ENTRY:].any()


def test_the_hardest_part_is_among_them(program):
    stretches = representatives(program, DT)
    x = [np.asarray(one.reference(DT, 0).position)[:, 0] for one in stretches]
    assert any(((150e-3 < one) & (one < 170e-3)).sum() > 100 for one in x)


def test_straight_lines_of_one_direction_need_no_second_stretch(program):
    """They are alike: what is farthest from those chosen comes next, and likeness comes last."""
    features = np.array([[1.0, 0.0], [0.2, 0.0], [0.2, 0.0], [0.2, 1.0]])
    assert module._spread(features, 4) == [0, 3, 1]


def test_what_is_not_long_stays_as_it_is():
    job = job_named("cam", Pace(machine_named("bridgeport"), None, None))
    assert representatives(job, DT) == [job]


def test_a_stretch_of_a_contour_is_the_same_curve():
    for contour in (circle(3e-3), polygon([[0.0, 0.0], [4e-3, 0.0], [4e-3, 2e-3]])):
        length = float(contour.length)
        low, high = 0.23 * length, 0.81 * length
        part = between(contour, low, high)
        assert float(part.length) == pytest.approx(high - low, rel=1e-12)
        s = np.linspace(0.0, high - low, 57)
        points, wanted = np.asarray(part.position(s)), np.asarray(contour.position(low + s))
        np.testing.assert_allclose(points, wanted, atol=1e-15)
        assert not bool(part.closed)


@pytest.mark.parametrize(("low", "high"), [(-1.0, 1.0), (1e-3, 1e-3), (0.0, 1.0)])
def test_a_stretch_that_is_none_is_named(low, high):
    with pytest.raises(ValueError, match="low, high: needs 0 <= low < high"):
        between(circle(3e-3), low, high)
