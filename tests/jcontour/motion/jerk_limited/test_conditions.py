"""Factors that bring a motion within its limits, against samples of the motion itself."""

import numpy as np

from jcontour.geometry import contours
from jcontour.motion.blending import blended
from jcontour.motion.jerk_limited import planning
from jcontour.motion.jerk_limited.conditions import MARGIN, slower
from jcontour.motion.jerk_limited.limits import AxisLimits

SQUARE = contours.polygon([(0, 0), (20e-3, 0), (20e-3, 20e-3), (0, 20e-3)])
LIMITS = AxisLimits.of(2, acceleration=[3.0, 2.0], jerk=[150.0, 80.0], speed=0.2)


def test_cells_are_slowed_by_their_greatest_excess():
    """Cells of a motion, each made quicker or slower: the greatest share of a limit by samples."""
    motion = planning.jerk_limited(blended(SQUARE, 20e-6).path, 0.1, LIMITS)
    quicker = np.random.default_rng(0).uniform(0.5, 4.0, motion.nodes.size - 1)
    square = quicker[:, None] * motion._warp.square
    limits = AxisLimits(*LIMITS)
    actual = slower(motion._pieces, motion.feed, limits, motion._old, motion._cells, square)
    fraction = np.linspace(1e-9, 1 - 1e-9, 200)
    times = motion.nodes[:-1, None] + fraction * np.diff(motion.nodes)[:, None]
    rate = np.sqrt(quicker)[:, None, None]
    speed, acceleration, jerk = (
        rate**power * rows.reshape(*times.shape, 2)
        for power, rows in enumerate(motion.axes_at(times.ravel()), 1)
    )
    fed = np.linalg.norm(speed, axis=-1).max(axis=1) / 0.1
    shares = [
        np.abs(rows / limit).max(axis=(1, 2))
        for rows, limit in zip((speed, acceleration, jerk), limits, strict=True)
    ]
    most = np.maximum(np.maximum(shares[0], fed) ** 2, np.maximum(shares[1], shares[2] ** (2 / 3)))
    expected = (1 - MARGIN) / np.maximum(most, 1 - MARGIN)
    assert (expected < 0.3).any() and (expected > 0.99).any()
    assert (actual <= expected * (1 + 1e-9)).all()
    np.testing.assert_allclose(actual, expected, rtol=0.05)
    assert np.median(expected / actual) < 1.002
