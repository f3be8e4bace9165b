"""Optimal cross-coupled control against SciPy's Riccati solver."""

import numpy as np
import scipy.linalg

from jcontour.controllers.lq.contouring_lq import LQWeights
from jcontour.controllers.lq.preview_lq import CrossCoupledLQ
from tests.canonical import STEPS, plant, reference, round_path


def test_gains_are_those_of_an_endless_line_and_the_target_is_followed():
    machine, path = plant(2), reference(round_path(2))
    plan = CrossCoupledLQ(machine, LQWeights(1e6, 1e8, 1.0)).prepare(path)
    A, B, C = (np.asarray(matrix) for matrix in (machine.A, machine.B, machine.C))
    for k in (0, STEPS - 1):
        x, y = np.asarray(path.tangent)[k]
        normal = np.array([[-y, x]])
        Q = C.T @ (1e6 * np.eye(2) + 1e8 * normal.T @ normal) @ C
        H = scipy.linalg.solve_discrete_are(A, B, Q, np.eye(2))
        K = np.linalg.solve(np.eye(2) + B.T @ H @ B, B.T @ H @ A)
        np.testing.assert_allclose(plan.F[k], K, rtol=1e-8, atol=1e-8 * np.abs(K).max())


def test_a_steady_acceleration_leaves_no_error():
    """The target of x(k+1) = A x + B u along a parabola is a motion of the model."""
    from jcontour.controllers.feedback.state_feedback import accelerated_targets
    from jcontour.geometry.contours import line
    from jcontour.motion.references import from_samples

    machine, k = plant(1), np.arange(20.0)
    y = (1e-4 + 2e-5 * k + 3e-6 * k**2)[:, None]
    path = from_samples(y, np.ones_like(y), machine.dt, 4, line([0.0], [1.0]))
    target = accelerated_targets(machine, path)
    x, u = np.asarray(target.state), np.asarray(target.control)
    np.testing.assert_allclose(x @ np.asarray(machine.C).T, y[: len(x)], rtol=0, atol=1e-14)
    moved = x @ np.asarray(machine.A).T + u @ np.asarray(machine.B).T
    np.testing.assert_allclose(moved[:-1], x[1:], rtol=0, atol=1e-12)
