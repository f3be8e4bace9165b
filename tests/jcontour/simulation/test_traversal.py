import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.simulation.traversal import traversal_score


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


def test_around_a_sharp_corner_the_progress_finds_the_way():
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
    score = traversal_score(contour, tool, 0.001, progress=arc)
    assert score.peak < 1e-9 and np.isfinite(score.time) and np.all(np.diff(score.arc) > -1e-9)


@pytest.mark.parametrize("steps", [1023, 1024, 1025])
def test_samples_around_a_block_of_the_program_count_alike(steps):
    """Their number is no matter: the tool is off by what its sample says, to the last one."""
    contour, off = contours.line([0.0, 0.0], [0.1, 0.0]), np.linspace(1e-6, 1e-5, steps)
    score = traversal_score(contour, np.stack([np.linspace(0, 0.05, steps), off], axis=1), 0.001)
    np.testing.assert_allclose(score.error, off, rtol=1e-9)
    assert score.arc.size == steps and score.peak == pytest.approx(1e-5)
    assert score.rms == pytest.approx(float(np.sqrt(np.mean(off[1:] ** 2))))
