"""The zero terminal state against the whole problem of a horizon, solved at once."""

import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    ZeroTerminal,
    contour_weight,
)
from jcontour.linear.plant import LinearPlant, steady_motion
from tests.canonical import plant, reference, round_path

PREVIEW, ALPHA, BETA, RHO = 8, 1e6, 1e8, 1.0


def test_the_control_is_that_of_the_problem_with_its_end_given():
    machine, path = plant(2), reference(round_path(2), preview=PREVIEW)
    assert ZeroTerminal().settled(machine) == 4
    law = ContouringLQ(machine, LQWeights(ALPHA, BETA, RHO), PREVIEW, ZeroTerminal())
    plan = law.prepare(path)
    A, B, C = (np.asarray(matrix) for matrix in (machine.A, machine.B, machine.C))
    motion, y = steady_motion(machine), np.asarray(path.position)
    Q = np.asarray(contour_weight(ALPHA, BETA, path.tangent))
    for k in (0, 7):
        x = np.random.default_rng(k).standard_normal(8) * 1e-4
        powers = [np.linalg.matrix_power(A, j) for j in range(PREVIEW + 1)]
        G = [
            np.hstack([powers[j - i - 1] @ B if i < j else 0 * B for i in range(PREVIEW)])
            for j in range(PREVIEW + 1)
        ]
        W, w = RHO * np.eye(2 * PREVIEW), np.zeros(2 * PREVIEW)
        for j in range(1, PREVIEW):
            W += (C @ G[j]).T @ Q[k + j] @ C @ G[j]
            w += (C @ G[j]).T @ Q[k + j] @ (C @ powers[j] @ x - y[k + j])
        end = np.asarray(motion.state(y[k + PREVIEW], y[k + PREVIEW] - y[k + PREVIEW - 1]))
        unit = np.abs(G[-1]).max(axis=1)
        R, size = G[-1] / unit[:, None], np.abs(W).max()
        system = np.block([[W / size, R.T], [R, np.zeros((8, 8))]])
        right = np.concatenate([-w / size, (end - powers[-1] @ x) / unit])
        U = np.linalg.solve(system, right)[: 2 * PREVIEW]
        np.testing.assert_allclose(powers[-1] @ x + G[-1] @ U, end, rtol=0, atol=1e-9)
        actual = np.asarray(plan.f[k]) - np.asarray(plan.F[k]) @ x
        np.testing.assert_allclose(actual, U[:2], rtol=1e-8, atol=1e-8 * np.abs(U).max())


def test_short_horizons_and_states_out_of_reach_are_refused():
    machine = plant(1)
    with pytest.raises(ValueError, match="takes 4 samples to reach, needs a longer preview"):
        ContouringLQ(machine, LQWeights(1.0, 1.0, 1.0), 4, ZeroTerminal())
    apart = LinearPlant(np.diag([0.5, 0.6]), [[1.0], [0.0]], [[1.0, 1.0]], 1e-3)
    with pytest.raises(ValueError, match="do not reach every state"):
        ZeroTerminal().settled(apart)
