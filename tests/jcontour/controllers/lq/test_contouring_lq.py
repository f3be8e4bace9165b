import warnings
from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    ModelFeedback,
    OutputTerminal,
    RiccatiTerminal,
    ZeroTerminal,
    balanced,
    contour_weight,
)
from jcontour.controllers.lq.scheduled_lq import BlockwiseLQ
from jcontour.geometry.contours import circle
from jcontour.linear.plant import AffinePlan, LinearPlant, SteadyMotion, steady_motion
from jcontour.motion.references import along, from_samples
from jcontour.simulation.closed_loop import prepared, simulate
from tests.canonical import plant, reference, round_path

T = 7


def reference_of(seed, axes, preview, dt=1e-3):
    """Samples and directions that have nothing to do with one another: the law must not care."""
    random = np.random.default_rng(seed)
    tangent = random.standard_normal((T + preview, axes))
    return from_samples(
        random.standard_normal((T + preview, axes)),
        tangent / np.linalg.norm(tangent, axis=1, keepdims=True),
        dt,
        preview,
    )


def best_first_control(model, weights, preview, H_N, x_d, reference, k, x):
    """Control u(k) by one least-squares problem over the whole horizon, without recursion."""
    A, B, C = (np.asarray(m) for m in (model.A, model.B, model.C))
    y_d, r = np.asarray(reference.position), np.asarray(reference.tangent)
    n, p = B.shape
    stage = np.ones(preview) if weights.stage is None else np.asarray(weights.stage)
    free, forced = x, np.zeros((n, preview * p))  # x(k+j) = free + forced u
    rows, target = [], []
    for j in range(1, preview + 1):
        free, forced = A @ free, A @ forced
        forced[:, (j - 1) * p : j * p] += B
        if j < preview or H_N is None:
            Q = stage[j - 1] * (
                float(weights.alpha + weights.beta) * np.eye(len(C))
                - float(weights.beta) * np.outer(r[k + j], r[k + j])
            )
            values, vectors = np.linalg.eigh(Q)
            root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
            rows.append(root @ C @ forced)
            target.append(root @ (y_d[k + j] - C @ free))
        else:
            values, vectors = np.linalg.eigh(stage[-1] * H_N)
            root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
            rows.append(root @ forced)
            target.append(root @ (x_d[k] - free))
    R = np.asarray(weights.rho) if np.ndim(weights.rho) else float(weights.rho) * np.eye(p)
    rows.append(np.kron(np.eye(preview), np.linalg.cholesky(R).T))
    target.append(np.zeros(preview * p))
    return np.linalg.lstsq(np.vstack(rows), np.concatenate(target), rcond=None)[0][:p]


PROFILE = [0.5, 2.0, 1.0, 0.3, 4.0, 1.5]
# axes, states, preview, arguments of `LQWeights`
CASES = {
    "three axes": (3, 9, 4, (0.7, 3.0, 0.2)),
    "profile": (2, 5, 6, (0.7, 3.0, 0.2, PROFILE)),
    "no tracking weight": (2, 5, 3, (0.0, 3.0, 0.2)),
    "a weight for every pair of controls": (3, 7, 4, (0.7, 3.0, balanced(0.2, 3, 1, 2, 5.0))),
    "one sample": (2, 4, 1, (2.0, 1.0, 0.05, [3.0])),
}


@pytest.mark.parametrize("terminal", ["output", "riccati"])
@pytest.mark.parametrize("case", CASES)
def test_control_is_the_minimiser_of_the_stated_cost(case, terminal, coupled_plant):
    axes, states, preview, values = CASES[case]
    weights = LQWeights(*values)
    model = coupled_plant(len(case), states, axes)
    random = np.random.default_rng(1)
    Sy, Sv = random.standard_normal((2, states, axes))
    reference = reference_of(2, axes, preview)
    end = (
        OutputTerminal()
        if terminal == "output"
        else RiccatiTerminal(SteadyMotion(placed(Sy), placed(Sv)))
    )
    controller = ContouringLQ(model, weights, preview, end)
    rollout = jax.device_get(simulate(model, controller, reference, random.standard_normal(states)))
    H_N = x_d = None
    if terminal == "riccati":
        A, B, C = (np.asarray(m) for m in (model.A, model.B, model.C))
        R = (
            np.asarray(weights.rho)
            if np.ndim(weights.rho)
            else float(weights.rho) * np.eye(B.shape[1])
        )
        H_N = solve_discrete_are(A, B, float(weights.alpha + weights.beta) * C.T @ C, R)
        y_d = np.asarray(reference.position)[preview - 1 :]
        x_d = y_d[1:] @ Sy.T + np.diff(y_d, axis=0) @ Sv.T
    for k in (0, 1, T - 1):
        wanted = best_first_control(
            model, weights, preview, H_N, x_d, reference, k, rollout.state[k]
        )
        np.testing.assert_allclose(
            rollout.control[k], wanted, rtol=1e-9, atol=1e-9 * np.abs(rollout.control).max()
        )


def test_contour_weight_forgives_what_is_along():
    tangent = np.array([[0.6, 0.8], [1.0, 0.0]])
    Q = np.asarray(jax.jit(contour_weight)(2.0, 5.0, tangent))
    along, across = (
        np.einsum("tij,tj->ti", Q, tangent),
        np.einsum("tij,tj->ti", Q, tangent[:, ::-1] * [-1, 1]),
    )
    np.testing.assert_allclose(along, 2.0 * tangent)
    np.testing.assert_allclose(across, 7.0 * tangent[:, ::-1] * [-1, 1])


@pytest.mark.parametrize(
    ("weights", "words"),
    [
        ((-1.0, 1.0, 1.0), "alpha: needs a finite weight of at least zero"),
        ((1.0, np.nan, 1.0), "beta"),
        ((1.0, 1.0, 0.0), "rho: needs a finite weight above zero"),
        ((1.0, 1.0, [[1.0, 2.0], [2.0, 1.0]]), "rho: needs a finite weight above zero"),
        ((0.0, 0.0, 1.0), "alpha, beta"),
        ((1.0, 1.0, 1.0, [1.0, 0.0]), "stage"),
    ],
)
def test_bad_weights_are_named(weights, words):
    with pytest.raises(ValueError, match=words):
        LQWeights(*weights)


def test_bad_controllers_are_named(any_type, two_axes):
    with pytest.raises(ValueError, match="preview: needs a whole number"):
        ContouringLQ(two_axes, LQWeights(1, 1, 1), 0)
    with pytest.raises(ValueError, match="received 2.7"):
        ContouringLQ(two_axes, LQWeights(1, 1, 1), 2.7)
    with pytest.raises(ValueError, match=r"stage.*shape \(3,\), received \(2,\)"):
        ContouringLQ(two_axes, LQWeights(1, 1, 1, [1.0, 1.0]), 3)
    with pytest.raises(
        ValueError, match=r"rho: needs one number or shape \(2, 2\), received \(3, 3\)"
    ):
        ContouringLQ(two_axes, LQWeights(1, 1, np.eye(3)), 3)
    out_of_reach = LinearPlant(np.diag([1.1, 0.5]), [[0.0], [1.0]], np.eye(2), 1.0)
    with pytest.raises(ValueError, match="no stabilising solution"):
        ContouringLQ(out_of_reach, LQWeights(1, 1, 1), 3, RiccatiTerminal())


def test_a_subclass_may_have_a_law_of_its_own(two_axes):
    class Halved(ContouringLQ):
        def step(self, memory, plan, measurement):
            memory, control = super().step(memory, plan, measurement)
            return memory, 0.5 * control

    given, reference = (two_axes, LQWeights(3.0, 5.0, 2e-9), 3), reference_of(5, 2, 3)
    assert ContouringLQ(*given).decoupled_problem(reference) is not None
    assert Halved(*given).decoupled_problem(reference) is None  # no kernel stands for its run
    plans = ContouringLQ(*given).prepare(reference), prepared(Halved(*given), reference)
    np.testing.assert_allclose(plans[0].F, plans[1].F, rtol=1e-7)


class Given(ModelFeedback):
    plan: AffinePlan
    model: LinearPlant
    preview: int = eqx.field(static=True, default=0)

    def gain_schedule(self, reference):
        return self.plan


def test_the_control_is_that_of_the_plan(two_axes):
    random = np.random.default_rng(0)
    plan = AffinePlan(*(placed(random.standard_normal(s)) for s in ((5, 2, 4), (5, 2))))
    reference = along(circle(1e-2), 1e-4 * np.arange(5), 1e-3, 0, at_rest=True)
    actual = jax.device_get(simulate(two_axes, Given(plan, two_axes), reference))
    x = actual.state[0]
    for k in range(5):
        u = plan.f[k] - plan.F[k] @ x
        np.testing.assert_allclose(actual.control[k], u, rtol=1e-12, atol=1e-15)
        x = np.asarray(two_axes.A) @ x + np.asarray(two_axes.B) @ u


def test_the_control_of_a_drive_that_takes_a_position_counts_from_where_it_stands():
    """It is planned from zero there: u = y_0 / K + f - F (x - x_0), by hand."""
    gain, pole = np.array([2.0, 0.5]), np.array([0.9, 0.8])
    drives = LinearPlant(np.diag(pole), np.diag(gain * (1 - pole)), np.eye(2), 1e-3)
    random = np.random.default_rng(1)
    plan = AffinePlan(*(placed(random.standard_normal(s)) for s in ((5, 2, 2), (5, 2))))
    reference = along(circle(1e-2), 1e-4 * np.arange(5), 1e-3, 0, at_rest=True)
    start = np.asarray(reference.position)[0] + np.array([0.3, -0.7])
    reference = replace(reference, position=reference.position + np.array([[0.3, -0.7]]))
    actual = jax.device_get(Given(plan, drives).prepare(reference))
    x = random.standard_normal(2)
    for k in range(5):
        u = start / gain + plan.f[k] - plan.F[k] @ (x - start)
        np.testing.assert_allclose(actual.f[k] - actual.F[k] @ x, u, rtol=1e-12)


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


def test_a_horizon_in_which_no_control_acts_is_warned_of():
    """The least cost is then that of no control: all gains are zero."""
    weights, machine = LQWeights(1.0, 1.0, 1e-6), plant(2)
    for law in (ContouringLQ, BlockwiseLQ):
        with pytest.warns(UserWarning, match="3 samples are shorter than the plant's delay of 4"):
            law(machine, weights, 3)
    with pytest.warns(UserWarning, match="a control acts past all that was seen"):
        idle = ContouringLQ(machine, weights, 3).gain_schedule(reference_of(1, 2, 4))
    assert not np.any(idle.F)
    assert not np.any(idle.f)
    with warnings.catch_warnings(action="error"):
        assert np.any(ContouringLQ(machine, weights, 4).gain_schedule(reference_of(1, 2, 4)).F)
        ContouringLQ(machine, weights, 3, RiccatiTerminal())  # its cost goes on past the horizon


def test_short_horizons_and_states_out_of_reach_are_refused():
    machine = plant(1)
    with pytest.raises(ValueError, match="takes 4 samples to reach, needs a longer preview"):
        ContouringLQ(machine, LQWeights(1.0, 1.0, 1.0), 4, ZeroTerminal())
    apart = LinearPlant(np.diag([0.5, 0.6]), [[1.0], [0.0]], [[1.0, 1.0]], 1e-3)
    with pytest.raises(ValueError, match="do not reach every state"):
        ZeroTerminal().settled(apart)
