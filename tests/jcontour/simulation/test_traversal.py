import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.simulation.traversal import outrun, traversal_score


def test_lap_of_a_wider_circle():
    contour, radius = contours.circle(0.02), 0.0201
    angle = np.linspace(0, 2 * np.pi, 401)[:, None]
    score = traversal_score(contour, radius * np.hstack([np.cos(angle), np.sin(angle)]), 0.01)
    last = int(np.ceil((2 * np.pi - 0.5e-3 / 0.02) / (2 * np.pi / 400)))
    assert (
        score.time == pytest.approx(0.01 * last)
        and score.rms == pytest.approx(1e-4, rel=1e-9)
        and score.peak == pytest.approx(1e-4)
    )
    np.testing.assert_allclose(score.arc[:-1], 0.02 * angle[:-1, 0], atol=1e-9)


def test_the_first_sample_and_those_after_the_end_do_not_count():
    contour = contours.line([0.0, 0.0], [0.1, 0.0])
    x = np.linspace(0, 0.12, 241)
    output = np.stack([x, np.where((x == 0) | (x > 0.1), 1e-3, 1e-5)], axis=1)
    score = traversal_score(contour, output, 0.001)
    assert (
        score.rms == pytest.approx(1e-5)
        and score.peak == pytest.approx(1e-5)
        and score.time == pytest.approx(0.199)
    )


def test_a_run_that_does_not_arrive_has_no_time():
    contour = contours.line([0.0, 0.0], [0.1, 0.0])
    score = traversal_score(
        contour, np.stack([np.linspace(0, 0.05, 50), np.full(50, 1e-5)], axis=1), 0.001
    )
    assert np.isnan(score.time) and score.rms == pytest.approx(1e-5)


def test_around_a_sharp_corner_the_tool_is_found_on_its_other_leg():
    """A tool that cuts a corner of ten degrees.

    Seen from the sample before, the other leg is too far along the path.
    """
    tip = 0.02 * np.array([np.cos(0.1745), np.sin(0.1745)])
    contour = contours.polyline([[0.0, 0.0], [0.02, 0.0], np.array([0.02, 0.0]) - tip * [1, -1]])
    arc = np.linspace(0, 0.04, 401)
    tool = np.asarray(
        contour.position(
            np.where((arc > 0.017) & (arc < 0.023), np.where(arc < 0.02, 0.017, 0.023), arc)
        )
    )
    score = traversal_score(contour, tool, 0.001)
    assert score.peak < 1e-9 and np.isfinite(score.time) and np.all(np.diff(score.arc) > -1e-9)


def test_a_tool_on_its_way_back_along_the_same_line_is_on_its_way_back():
    """A plunge of 2 mm and its retraction, 10 um beside the line."""
    contour = contours.polyline([[0.0, 0.0], [0.0, -2e-3], [0.0, 0.0]])
    arc = np.linspace(0, 4e-3, 401)
    tool = np.stack([np.full(401, 1e-5), np.abs(arc - 2e-3) - 2e-3], axis=1)
    score = traversal_score(contour, tool, 0.001)
    np.testing.assert_allclose(score.error, 1e-5, rtol=1e-6)
    off, turn = np.abs(score.arc - arc), np.minimum(np.abs(arc - 2e-3), arc)
    assert off[turn > 2e-4].max() < 1e-9  # around a turn both ways are within reach
    assert off.max() < 4e-4
    assert score.time == pytest.approx(0.35)


@pytest.mark.parametrize("angle", [0.065, -0.065, 0.5, -3.0, -9.0])
def test_a_tool_that_stays_at_the_start_of_a_closed_path_has_not_come_to_its_end(angle):
    """It moves along the circle by so many rad within 200 samples, and vibrates by 1 um."""
    contour, turn = contours.circle(1e-3), np.linspace(0, angle, 200)
    radius = 1e-3 + 1e-6 * np.sin(np.arange(200.0))
    tool = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    score = traversal_score(contour, tool, 0.001)
    np.testing.assert_allclose(score.arc, 1e-3 * turn, atol=1e-9)
    np.testing.assert_allclose(score.error, np.abs(radius - 1e-3), atol=1e-12)
    assert np.isnan(score.time)


def test_a_tool_that_crosses_the_inside_of_a_circle_has_not_gone_round_it():
    """From the top straight down to the right half, and out of the circle at -20 degrees."""
    contour = contours.circle(1e-3)
    way = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, -0.2], [1.5, -0.55]])
    turn = np.linspace(0, np.pi / 2, 200)
    arc = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    parts = [np.linspace(way[k], way[k + 1], 200) for k in (1, 2)]
    score = traversal_score(contour, 1e-3 * np.concatenate([arc, *parts]), 0.001)
    assert np.isnan(score.time) and score.arc.max() == pytest.approx(1e-3 * np.pi / 2)
    assert score.arc[-1] == pytest.approx(1e-3 * np.arctan2(-0.55, 1.5))


def test_a_tool_that_goes_back_for_a_while_is_seen_where_it_is():
    """Its error is that across the path: how far it goes back is none."""
    contour, arc = contours.line([0.0, 0.0], [0.1, 0.0]), 0.02 + 0.01 * np.sin(np.arange(300) / 40)
    score = traversal_score(contour, np.stack([arc, np.full(300, 1e-5)], axis=1), 0.001, start=0.02)
    np.testing.assert_allclose(score.arc, arc, atol=1e-12)
    np.testing.assert_allclose(score.error, 1e-5, rtol=1e-9)


@pytest.mark.parametrize(
    ("progress_mm", "tool_mm", "left"), [(99.8, 50.0, True), (99.0, 50.0, False), (100, 100, False)]
)
def test_outrun_is_a_tool_whose_controller_alone_has_come_to_the_end(progress_mm, tool_mm, left):
    """On a line of 100 mm, its margin half a millimetre."""
    contour = contours.line([0.0, 0.0], [0.1, 0.0])
    tool = np.stack([1e-3 * np.linspace(0, tool_mm, 50), np.full(50, 1e-5)], axis=1)
    score = traversal_score(contour, tool, 0.001)
    assert outrun(contour, score, 1e-3 * np.linspace(0, progress_mm, 50)) is left


@pytest.mark.parametrize("steps", [1023, 1024, 1025])
def test_samples_around_a_block_of_the_program_count_alike(steps):
    """Their number is no matter: the tool is off by what its sample says, to the last one."""
    contour, off = contours.line([0.0, 0.0], [0.1, 0.0]), np.linspace(1e-6, 1e-5, steps)
    score = traversal_score(contour, np.stack([np.linspace(0, 0.05, steps), off], axis=1), 0.001)
    np.testing.assert_allclose(score.error, off, rtol=1e-9)
    assert score.arc.size == steps and score.peak == pytest.approx(1e-5)
    assert score.rms == pytest.approx(float(np.sqrt(np.mean(off[1:] ** 2))))
