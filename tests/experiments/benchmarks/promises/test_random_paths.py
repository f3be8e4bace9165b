"""Random toolpaths: what is asked of them, and that their motions keep it."""

import dataclasses

import jax
import numpy as np
import pytest

from experiments.benchmarks.promises import kept_promises
from experiments.benchmarks.promises.kept_promises import checked, stopping_time
from experiments.benchmarks.promises.motion import broken
from experiments.benchmarks.promises.random_paths import KINDS, random_path
from jcontour.motion.cornering import cornered
from jcontour.motion.jerk_limited.joints import joints, unpadded
from jcontour.motion.jerk_limited.limits import AxisLimits


@pytest.mark.parametrize(
    "seed", [0, 3, 7, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 4, 5, 6))]
)
def test_paths_have_two_to_fifty_pieces_that_meet(seed):
    path = random_path(seed)
    pieces = jax.tree.map(lambda rows: np.asarray(rows)[:, None], path.contour.pieces)
    extent = pieces.extent
    assert path.kind == KINDS[seed % 8] and 2 <= extent.size <= 50
    begin, end = (pieces.jet(part * extent)[0][:, 0] for part in (0.0, 1.0))
    np.testing.assert_allclose(begin[1:], end[:-1], atol=1e-12)
    if path.points is not None:
        np.testing.assert_allclose(begin, path.points[:-1], atol=1e-15)


def test_lines_and_arcs_go_on_smoothly_in_some_joints():
    path = random_path(7)
    found = joints(unpadded(path.contour))
    smooth = found.smooth(path.feed, float(path.limits.acceleration.min()))
    arcs = np.asarray(path.contour.rate) > 0
    assert smooth[arcs[1:] & arcs[:-1]].any() and smooth[~arcs[1:] & ~arcs[:-1]].any()
    assert 0.2 < smooth.mean() < 0.6


def test_time_of_stopping_in_closed_form():
    """Two lines that reach neither feed nor acceleration: each takes cbrt(32 length / jerk)."""
    limits = AxisLimits.of(2, acceleration=1e3, jerk=[1.0, 8.0])
    points = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    assert stopping_time(points, np.full(2, 1e3), limits) == pytest.approx(4.0 + 2.0, rel=1e-12)


# in 18, 41 and 90 a curve swings between its points where some moves have too few of them, in 2930
# where the distance is known at them alone; of 1138783 a jerk turns by its third difference between
# two places that are looked at
@pytest.mark.parametrize("seed", [3, 6, 8, 13, 18, 41, 90, 2930, 1138783])
def test_a_path_keeps_all_promises(seed):
    assert broken(checked(seed)) == []


def test_a_jerk_above_its_limit_is_found(monkeypatch):
    def loose(contour, feed, limits, tolerance, alike):
        planned = cornered(contour, feed, limits._replace(jerk=1.1 * limits.jerk), tolerance)
        return planned._replace(motion=dataclasses.replace(planned.motion, limits=limits))

    monkeypatch.setattr(kept_promises, "cornered", loose)
    assert broken(checked(4)) == ["jerk"]


def test_a_corner_cut_too_far_is_found(monkeypatch):
    def loose(contour, feed, limits, tolerance, alike):
        planned = cornered(contour, feed, limits, 2 * tolerance)
        return planned._replace(around=dataclasses.replace(planned.around, deviation=0.0))

    monkeypatch.setattr(kept_promises, "cornered", loose)
    assert broken(checked(4)) == ["deviation"]


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 400, 40))
def test_many_paths_keep_all_promises(first):
    found = [checked(seed) for seed in range(first, first + 40)]
    assert [(row.seed, broken(row)) for row in found if broken(row)] == []
