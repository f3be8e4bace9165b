"""Distances to the true path: against dense samples of where the tool may be."""

import numpy as np
import pytest

from jcontour.bounds.distance import _between, distance_bounds, frames_along
from jcontour.geometry.contours import circle, polygon, polyline, spline
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.motion.references import along

PATHS = {
    "square": lambda: polygon([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3], [0.0, 1e-3]]),
    "circle": lambda: circle(1e-3),
    "corner": lambda: polyline(np.array([[0.0, 0.0], [1e-3, 0.0], [2e-4, 7e-4]])),
    "lobes": lambda: polar_lobes(3e-3, 1e-3, 3),
}


def run_along(name):
    """A reference and a run beside it, both sides in turn."""
    path = PATHS[name]()
    arc = np.linspace(0.0, 0.97 * float(path.length), 40)
    reference = along(path, arc, 1e-3, 1, at_rest=False)
    random = np.random.default_rng(5)
    steps = np.asarray(reference.position)[: reference.steps]
    return reference, steps + random.uniform(-1e-5, 1e-5, steps.shape)


@pytest.mark.parametrize(
    "name",
    ["square", *(pytest.param(n, marks=pytest.mark.slow) for n in ("circle", "corner", "lobes"))],
)
def test_no_point_that_the_tool_may_reach_is_farther(name):
    reference, output = run_along(name)
    frames = frames_along(reference, output)
    random = np.random.default_rng(6)
    across, along_path = random.uniform(0, 2e-5, (2, reference.steps))
    bound = distance_bounds(reference, output, frames, across, along_path)
    a, b = (part.ravel() for part in np.meshgrid(*[np.linspace(-1, 1, 21)] * 2))
    moved = (a * across[:, None])[..., None] * frames.normals
    moved = moved + (b * along_path[:, None])[..., None] * frames.tangent[:, None]
    points = output[:, None] + moved
    nearest = reference.contour.nearest_anywhere(points)
    apart = np.linalg.norm(points - np.asarray(reference.contour.position(nearest)), axis=2)
    largest = apart.max(axis=1)
    assert np.all(largest <= bound * (1 + 1e-12))
    looser = np.sort(bound - largest)
    assert looser[: 3 * looser.size // 4].max() < 1e-7  # the others are at corners


def test_the_middle_of_a_chord_is_a_sagitta_away_and_the_bound_hardly_more():
    arcs, on_the_path = np.array([[0.0, 0.4]]), np.zeros((1, 2))
    (actual,) = _between(circle(1.0), arcs, on_the_path, np.full(1, 0.4))
    assert 1 - np.cos(0.2) <= actual <= 1.01 * (1 - np.cos(0.2))


def test_beside_a_line_the_bound_is_the_sum():
    path = polyline(np.array([[0.0, 0.0], [1.0, 0.0]]))
    reference = along(path, np.linspace(0.4, 0.6, 5), 1e-3, 1, at_rest=False)
    output = np.asarray(reference.position)[:5] + np.array([0.0, 3e-6])
    frames = frames_along(reference, output)
    actual = distance_bounds(reference, output, frames, np.full(5, 1e-6), np.full(5, 9e-6))
    assert actual == pytest.approx(np.full(5, 4e-6), rel=1e-9)


@pytest.mark.slow
def test_beyond_the_end_of_a_curve_both_deviations_are_legs_of_a_triangle():
    """Nothing of the path is ahead: the end is nearest to all that lies there, across or not."""
    path = spline(np.array([[0.0, 0.0], [1e-3, 2e-4], [2e-3, 1e-3], [2.5e-3, 2.5e-3]]))
    reference = along(path, np.linspace(0.0, float(path.length), 40), 1e-3, 1, at_rest=True)
    output = np.asarray(reference.position)[: reference.steps]
    across, along_path = (np.full(reference.steps, size) for size in (126e-6, 137e-6))
    frames = frames_along(reference, output)
    actual = distance_bounds(reference, output, frames, across, along_path)
    assert actual[[0, -1]] == pytest.approx(np.hypot(126e-6, 137e-6), rel=1e-6)
    assert actual.max() == pytest.approx(actual[-1], rel=1e-6)


def test_normals_are_orthonormal_in_space():
    corners = np.array([[0.0, 0.0, 0.0], [1e-3, 2e-3, 1e-3], [2e-3, 0.0, 0.0]])
    reference = along(polyline(corners), np.linspace(0, 4e-3, 9), 1e-3, 1, at_rest=False)
    frames = frames_along(reference, np.asarray(reference.position)[: reference.steps])
    basis = np.concatenate([frames.normals, frames.tangent[:, None]], axis=1)
    assert basis @ np.swapaxes(basis, 1, 2) == pytest.approx(
        np.broadcast_to(np.eye(3), (9, 3, 3)), abs=1e-12
    )


def test_a_run_that_left_its_contour_is_told():
    reference, output = run_along("square")
    with pytest.raises(ValueError, match="leaves its contour"):
        frames_along(reference, output + 1.0)


@pytest.mark.parametrize("away", [0.0, 2e-5, -3e-5])
def test_a_circle_is_exact_against_dense_samples(away, circle_bound):
    generators = 1e-5 * np.random.default_rng(7).standard_normal((2, 4))
    output, centre = np.array([1e-3 + away, 0.0]), np.zeros(2)
    outside, inside = circle_bound(centre, 1e-3, output, generators)
    grid = np.linspace(-1, 1, 9)
    corners = np.stack([part.ravel() for part in np.meshgrid(*[grid] * 4)])
    radii = np.linalg.norm(output + (generators @ corners).T, axis=1)
    assert outside == pytest.approx(radii.max() - 1e-3, rel=1e-9)
    assert radii.min() >= 1e-3 - inside - 1e-15
    assert radii.min() == pytest.approx(1e-3 - inside, abs=3e-6)


def test_the_centre_within_reach_is_a_whole_radius_away(circle_bound):
    _, inside = circle_bound(np.zeros(2), 1.0, np.array([0.1, 0.1]), np.eye(2))
    assert inside == 1.0


def test_a_segment_in_line_with_the_centre(circle_bound):
    outside, inside = circle_bound(np.zeros(2), 1.0, np.array([1.0, 0.0]), np.array([[0.2], [0.0]]))
    assert (outside, inside) == pytest.approx((0.2, 0.2), rel=1e-12)
