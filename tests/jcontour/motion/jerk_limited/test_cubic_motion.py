"""Motions of piecewise constant jerk against splines of SciPy."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from jcontour.motion.jerk_limited.cubic_motion import through


def ramp(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Uneven times, and places of a smooth motion from rest to rest."""
    steps = np.random.default_rng(seed).uniform(0.5, 1.5, count)
    time = 3.0 + np.append(0.0, np.cumsum(steps)) / steps.sum()
    q = time - time[0]
    return time, 0.1 * (10 * q**3 - 15 * q**4 + 6 * q**5)


def spline_from_rest(time: np.ndarray, arc: np.ndarray):
    """Cubic spline with one more knot in the first and in the last interval, at rest at both."""
    middle = 0.5 * (time[[0, -2]] + time[[1, -1]])
    nodes = np.sort(np.concatenate([time, middle]))
    knots = np.concatenate([[nodes[0]] * 3, nodes, [nodes[-1]] * 3])
    still = [(1, 0.0), (2, 0.0)]
    return make_interp_spline(time, arc, k=3, t=knots, bc_type=(still, still)), nodes


@pytest.mark.parametrize("counts", [[40], [5, 12, 30], [2, 3]])
def test_splines_of_several_motions_are_those_of_each(counts):
    parts = [ramp(count, seed) for seed, count in enumerate(counts)]
    time, arc = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    found = through(time, arc, np.cumsum([0, *(one[0].size for one in parts)]))
    assert found is not None and len(found) == len(counts)
    for motion, part in zip(found, parts, strict=True):
        expected, nodes = spline_from_rest(*part)
        np.testing.assert_allclose(motion.time, nodes, rtol=1e-15)
        at = np.linspace(nodes[0], nodes[-1], 201)
        samples = motion.at(at)
        for k, size in ((0, 1e-14), (1, 1e-13), (2, 1e-11)):
            np.testing.assert_allclose(samples[k], expected(at, nu=k), atol=size)
        assert samples.speed[0] == 0 and samples.acceleration[0] == 0


def test_a_motion_that_goes_back_is_none():
    time, arc = ramp(20, seed=0)
    arc[10] = arc[9]  # it stands still for a moment: the spline overshoots
    assert through(time, arc, np.array([0, time.size])) is None
