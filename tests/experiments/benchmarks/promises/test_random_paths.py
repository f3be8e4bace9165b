"""Random toolpaths: what is asked of a motion along them."""

import jax
import numpy as np
import pytest

from experiments.benchmarks.promises.random_paths import KINDS, random_path
from jcontour.motion.jerk_limited.joints import joints, unpadded


@pytest.mark.parametrize("seed", range(len(KINDS)))
def test_paths_have_two_to_fifty_pieces_that_meet(seed):
    path = random_path(seed)
    pieces = jax.tree.map(lambda rows: np.asarray(rows)[:, None], path.contour.pieces)
    extent = pieces.extent
    assert path.kind == KINDS[seed % len(KINDS)] and 2 <= extent.size <= 50
    begin, end = (pieces.jet(part * extent)[0][:, 0] for part in (0.0, 1.0))
    np.testing.assert_allclose(begin[1:], end[:-1], atol=1e-12)
    if path.points is not None:
        np.testing.assert_allclose(begin, path.points[:-1], atol=1e-15)


def test_lines_and_arcs_go_on_smoothly_in_some_joints():
    path = random_path(8)
    found = joints(unpadded(path.contour))
    smooth = found.smooth(path.feed, float(path.limits.acceleration.min()))
    arcs = np.asarray(path.contour.rate) > 0
    assert smooth[arcs[1:] & arcs[:-1]].any() and smooth[~arcs[1:] & ~arcs[:-1]].any()
    assert 0.2 < smooth.mean() < 0.6
