"""Optimal cross-coupled control against SciPy's Riccati solver."""

import numpy as np
import pytest
import scipy.linalg

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal
from jcontour.controllers.lq.preview_lq import CrossCoupledLQ, PreviewLQ
from jcontour.linear.plant import SteadyMotion
from jcontour.motion.references import from_samples
from jcontour.plants.linear_machines import bridgeport
from jcontour.simulation.closed_loop import prepared
from tests.canonical import STEPS, plant, reference, round_path

ALPHA, RHO = 3.0, 2e-9


def reference_of(preview, dt):
    angle = 0.025 * np.arange(9 + preview)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], -1)
    return from_samples(1e-3 * np.stack([np.cos(angle), np.sin(angle)], -1), tangent, dt, preview)


def check_gains(ours, theirs, reference):
    actual, wanted = (prepared(law, reference) for law in (ours, theirs))
    for name in ("F", "f"):
        gains = np.asarray(getattr(wanted, name))
        np.testing.assert_allclose(
            getattr(actual, name), gains, rtol=0, atol=1e-9 * np.abs(gains).max()
        )


@pytest.mark.parametrize("preview", [pytest.param(6, marks=pytest.mark.slow), 1])
def test_finite_preview_is_case_iii(preview):
    """McNab & Tsao: their law with beta = 0 and the Riccati terminal is Tomizuka & Whitney's."""
    plant = bridgeport()
    reference = reference_of(preview, plant.dt)
    theirs = ContouringLQ(plant, LQWeights(ALPHA, 0.0, RHO), preview, RiccatiTerminal())
    check_gains(PreviewLQ(plant, ALPHA, RHO, preview), theirs, reference)


def test_given_maps_serve_a_coupled_plant(coupled_plant):
    plant = coupled_plant(4, 5, 2)
    motion = SteadyMotion(*map(placed, np.random.default_rng(0).standard_normal((2, 5, 2))))
    reference = reference_of(4, plant.dt)
    theirs = ContouringLQ(plant, LQWeights(0.5, 0.0, 0.1), 4, RiccatiTerminal(motion))
    check_gains(PreviewLQ(plant, 0.5, 0.1, 4, motion), theirs, reference)


def test_a_preview_of_nothing_is_refused(two_axes):
    with pytest.raises(ValueError, match="preview: needs a whole number"):
        PreviewLQ(two_axes, 1.0, 1.0, 0)


@pytest.mark.parametrize(("alpha", "rho"), [(-1.0, 2e-9), (1.0, -5.0), (0.0, 1.0)])
def test_bad_weights_are_named(alpha, rho, coupled_plant):
    with pytest.raises(ValueError, match="alpha|rho"):
        PreviewLQ(coupled_plant(4, 5, 2), alpha, rho, 3)


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
