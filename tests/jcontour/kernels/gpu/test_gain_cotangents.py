"""The trajectories of the GPU's derivative; `test_lane_plan` asks for all of it."""

import numpy as np

from jcontour.kernels.gpu.gain_cotangents import paired, through
from jcontour.kernels.written_stage import Sizes, shape_of
from jcontour.linear.plant import Pattern


def test_a_trajectory_moves_with_the_closed_loop():
    random = np.random.default_rng(0)
    A, B, K, W = (random.standard_normal(shape) for shape in ((3, 3), (3, 2), (2, 4), (4,)))
    M = {(i, k): A[i, k] for i in range(3) for k in range(3)} | {
        (i, 4 + u): B[i, u] for i in range(3) for u in range(2)
    }
    KW, ahead = through(Sizes(3, 2, 2, 1, 2, True), M, K, list(W))
    np.testing.assert_allclose(KW, K @ W, rtol=1e-13)
    np.testing.assert_allclose(ahead, [*(A @ W[:3] - B @ (K @ W)), W[3]], rtol=1e-13)


def test_cotangent_of_the_cost():
    random = np.random.default_rng(0)
    C, U, V = (random.standard_normal(shape) for shape in ((2, 3), (2, 3), (2, 4)))
    shape = shape_of(Pattern.of(np.eye(3), np.ones((3, 2)), C))
    numbers = {(a, i): C[a, i] for a in (0, 1) for i in range(3)}
    found = dict(
        zip(shape.seen, paired(shape, Sizes(3, 2, 2, 1, 2, True), numbers, U, V), strict=True)
    )
    full = (C @ U.T) @ np.vstack([C @ V[:, :3].T, V[:, 3]]).T
    for (a, b), value in found.items():
        np.testing.assert_allclose(
            value, full[a, b] + (full[b, a] if a != b and b < 2 else 0), rtol=1e-13
        )
