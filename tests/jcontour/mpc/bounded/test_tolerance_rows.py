"""Frames along circles and corners: what is within their room is within the tolerance."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.motion import feed_laws, references
from jcontour.mpc.bounded.tolerance_rows import frames_of
from jcontour.sets.disturbed_model import DisturbedModel
from jcontour.sets.finite_responses import brought_to_rest

PEAK = 2e-4  # [m] of every axis, in one sample


@pytest.fixture(scope="module")
def response():
    """Two axes that are where they are told, one sample late, and pushed by 0.2 mm."""
    model = DisturbedModel.of(np.zeros((2, 2)), np.eye(2), PEAK * np.eye(2))
    return brought_to_rest(model, np.zeros((2, 2, 2)), np.zeros((0, 2)))


def frames_on(path, response, feed=0.05, at_rest=False):
    arc = feed_laws.constant_feed(path, feed, 1e-3)
    reference = references.along(path, arc, 1e-3, preview=4, at_rest=at_rest)
    return reference, frames_of(reference, np.asarray(reference.position), np.eye(2), response)


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [
        contours.circle(5e-3),
        contours.polyline([[0.0, 0.0], [5e-3, 0.0], [5e-3, 4e-3], [0.0, 1e-3]]),
    ],
    ids=["circle", "corners"],
)
def test_all_within_the_room_is_within_the_tolerance(path, response):
    reference, frames = frames_on(path, response)
    tolerance = 1.3 * frames.certified.max()
    room = frames.room(tolerance)
    generator = np.random.default_rng(0)
    worst = 0.0
    for k in range(0, reference.steps, 7):
        inside = generator.choice([-1.0, 1.0, 0.3], size=(20, 2)) * room[k]
        points = np.asarray(reference.position)[k] + inside @ frames.directions[k]
        foot = path.position(path.nearest_anywhere(points))
        worst = max(worst, float(np.linalg.norm(points - np.asarray(foot), axis=1).max()))
    assert 0.6 * tolerance < worst <= tolerance * (1 + 1e-12)


def test_a_circle_leaves_its_tangent_as_it_does(response):
    radius = 5e-3
    reference, frames = frames_on(contours.circle(radius), response)
    exact = np.hypot(radius, frames.along) - radius
    steps = slice(0, reference.steps)
    assert (frames.off[steps] >= exact[steps]).all()
    assert (frames.off[steps] <= exact[steps] + 1.001 * frames.along[steps] / 64).all()


def test_peaks_are_those_of_the_box_seen_along_the_frame(response):
    reference, frames = frames_on(contours.circle(5e-3), response)
    tangent = np.asarray(reference.tangent)
    np.testing.assert_allclose(frames.peak[:, 0], PEAK * np.abs(tangent).sum(axis=1))
    np.testing.assert_allclose(frames.peak, frames.growth[..., -1])
    assert not frames.nominal.any()


def test_one_axis_has_its_tracking_error_bounded():
    model = DisturbedModel.of([[0.0]], [[1.0]], [[PEAK]])
    response = brought_to_rest(model, np.zeros((2, 1, 1)), np.zeros((0, 1)))
    path = contours.polyline([[0.0], [0.01]])
    reference = references.along(path, 1e-4 * np.arange(50), 1e-3, preview=4, at_rest=False)
    late = np.asarray(reference.position) - 1e-5
    frames = frames_of(reference, late, np.eye(1), response)
    np.testing.assert_allclose(frames.certified, PEAK + 1e-5)
    assert frames.room(1e-3).shape == (54, 1) and (frames.room(1e-3) == 1e-3).all()


def test_three_axes_are_refused(response):
    path = contours.polyline([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    reference = references.along(path, 1e-3 * np.arange(5), 1e-3, preview=0, at_rest=False)
    with pytest.raises(ValueError, match="one or two axes, received 3"):
        frames_of(reference, np.asarray(reference.position), np.eye(3), response)
