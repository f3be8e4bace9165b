"""Points of whole contours, and the extremes among them."""

import jax
import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.outlines import outline


@pytest.mark.parametrize("start", [0.3, 2.0, -1.1])
@pytest.mark.parametrize("angle", [0.4, -2.5, 6.0])
def test_the_extremes_of_an_arc_are_found(start, angle):
    """Its ends, and where it crosses an axis."""
    low, high = sorted((start, start + angle))
    quarters = 0.5 * np.pi * np.arange(-4, 6)
    at = np.array([start, *quarters[(low < quarters) & (quarters < high)], start + angle])
    circle = 0.01 * np.stack([np.cos(at), np.sin(at)], axis=1)
    found = outline(contours.arc(circle[0], [0.0, 0.0], angle))
    np.testing.assert_allclose(found.min(axis=0), circle.min(axis=0), atol=1e-13)
    np.testing.assert_allclose(found.max(axis=0), circle.max(axis=0), atol=1e-13)
    np.testing.assert_allclose(found[[0, -1]], circle[[0, -1]], atol=1e-12)


def test_a_polyline_keeps_its_corners_and_ends_where_it_begins():
    points = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.015], [0.0, 0.0]])
    found = outline(contours.polyline(points))
    apart = np.linalg.norm(found[:, None] - points, axis=-1).min(axis=0)
    assert apart.max() < 1e-15 and np.ptp(found, axis=0) == pytest.approx([0.02, 0.015])
    np.testing.assert_allclose(found[-1], points[-1], atol=1e-12)
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert steps.sum() == pytest.approx(0.06) and steps.max() < 0.06 / 1000


def test_padding_of_a_stack_is_no_part_of_a_contour():
    pair = contours.stack(
        [contours.line([0.0, 0.0], [1.0, 0.0]), contours.polygon(np.eye(3)[:, :2])]
    )
    first = jax.tree.map(lambda rows: rows[0], pair)
    found = outline(first)
    assert found[:, 1].max() == found[:, 1].min() == 0
    np.testing.assert_allclose([found[:, 0].min(), found[:, 0].max()], [0.0, 1.0], atol=1e-12)
