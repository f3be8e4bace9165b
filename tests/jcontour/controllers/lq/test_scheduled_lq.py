from functools import cache

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal, balanced
from jcontour.controllers.lq.scheduled_lq import BlockwiseLQ, ScheduledLQ
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.plants.gantry.gantry import thesis_gantry
from jcontour.plants.gantry.linear_models import motor_schedule
from jcontour.simulation.closed_loop import prepared, simulate

DT, PREVIEW, T = 2e-3, 6, 9
POINTS = [-0.3, 0.0, 0.4]
ALPHA, BETA = 2e5, 3e6


@cache
def weighted():
    stage = [1.0, 2.0, 0.5, 1.0, 3.0, 1.5]
    return LQWeights(ALPHA, BETA, balanced(1.0, 3, 1, 2, 0.5), stage)


@pytest.fixture(scope="module")
def schedule():
    return motor_schedule(thesis_gantry(), POINTS, DT)


@pytest.fixture(scope="module")
def reference():
    # fast, to meet many models
    return along(circle(0.25), 0.08 * np.arange(T), DT, PREVIEW, at_rest=False)


def steady_costs(schedule, R):
    """H_s at every point of the schedule, by SciPy."""
    costs = []
    for index in range(schedule.points.size):
        model = schedule.model(index)
        A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
        costs.append(solve_discrete_are(A, B, (ALPHA + BETA) * C.T @ C, R))
    return np.stack(costs)


def interpolated(costs, head):
    """H_s at a head position, entry by entry."""
    flat = costs.reshape(len(POINTS), -1)
    entries = [np.interp(head, POINTS, column) for column in flat.T]
    return np.reshape(entries, costs.shape[1:])


def predicted(models, k, x):
    """States x(k+1) ... x(k+N_p) as free + forced u, u all N_p controls in a row."""
    free, forced, rows = x, np.zeros((6, 3 * PREVIEW)), []
    for j in range(PREVIEW):
        A, B = np.asarray(models.A)[k + j], np.asarray(models.B)[k + j]
        free, forced = A @ free, A @ forced
        forced[:, 3 * j : 3 * j + 3] += B
        rows.append((free, forced.copy()))
    return rows


def minimiser(schedule, reference, k, x):
    """First control of the N_p that minimise the cost, as one quadratic form c + 2 g'u + u'M u."""
    weights, models = weighted(), eqx.filter_jit(schedule.along)(reference.position)
    y_d, r = np.asarray(reference.position), np.asarray(reference.tangent)
    stage, R, end = np.asarray(weights.stage), np.asarray(weights.rho), k + PREVIEW
    speed = (y_d[end] - y_d[end - 1]) / DT
    x_d = np.array([y_d[end, 0], y_d[end, 1], y_d[end, 1], speed[0], speed[1], speed[1]])
    H = interpolated(steady_costs(schedule, R), y_d[end, 0])

    states = predicted(models, k, x)
    M, g = np.kron(np.eye(PREVIEW), R), np.zeros(3 * PREVIEW)
    for j, (free, forced) in enumerate(states[:-1], start=1):
        C = np.asarray(models.C)[k + j]
        across = np.eye(2) - np.outer(r[k + j], r[k + j])
        Q = stage[j - 1] * (ALPHA * np.eye(2) + BETA * across)
        M += (C @ forced).T @ Q @ C @ forced
        g += (C @ forced).T @ Q @ (C @ free - y_d[k + j])
    free, forced = states[-1]
    M += stage[-1] * forced.T @ H @ forced
    g += stage[-1] * forced.T @ H @ (free - x_d)
    return -np.linalg.solve(M, g)[:3]


@pytest.mark.parametrize("k", [0, T - 1])
def test_control_is_the_minimiser_of_the_stated_cost(schedule, reference, k):
    """The cost is written out over the models of the desired positions."""
    x = np.random.default_rng(k).normal(0, 0.01, 6)
    wanted = minimiser(schedule, reference, k, x)
    controller = ScheduledLQ(schedule, weighted(), PREVIEW)
    plan = jax.device_get(prepared(controller, reference))
    _, actual = controller.step(None, jax.tree.map(lambda rows: placed(rows[k]), plan), placed(x))
    np.testing.assert_allclose(actual, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())


def test_bad_controllers_are_named(schedule, reference):
    with pytest.raises(ValueError, match="preview: needs a whole number"):
        ScheduledLQ(schedule, weighted(), 0)
    with pytest.raises(
        ValueError,
        match=r"stage: needs one entry per preview sample, shape \(3,\), received \(6,\)",
    ):
        ScheduledLQ(schedule, weighted(), 3)
    with pytest.raises(ValueError, match="rho: needs one number or shape"):
        ScheduledLQ(schedule, LQWeights(1.0, 1.0, np.eye(2)), PREVIEW)
    with pytest.raises(ValueError, match="looks 6 samples ahead, the reference was made with 5"):
        ScheduledLQ(schedule, weighted(), PREVIEW).prepare(
            along(circle(0.2), 1e-4 * np.arange(5), DT, 5, at_rest=False)
        )
    with pytest.raises(ValueError, match=r"points: the models cover -0.3 to 0.4 m of output 0"):
        ScheduledLQ(schedule, weighted(), PREVIEW).prepare(
            along(circle(0.45), 1e-4 * np.arange(5), DT, PREVIEW, at_rest=False)
        )


WEIGHTS = LQWeights(0.7, 3.0, 0.2)


def arc(steps, preview, plant):
    return along(circle(1e-2), 2e-4 * np.arange(steps), plant.dt, preview, at_rest=False)


def least_squares_controls(model, reference, x):
    """All controls of a run at once, by the stacked cost over the whole of the reference."""
    A, B, C = (np.asarray(M) for M in (model.A, model.B, model.C))
    y_d, r = np.asarray(reference.position), np.asarray(reference.tangent)
    alpha, beta, rho = (float(w) for w in (WEIGHTS.alpha, WEIGHTS.beta, WEIGHTS.rho))
    count, p = len(y_d) - 1, B.shape[1]
    free, forced, rows, wanted = x, np.zeros((len(A), count * p)), [], []
    for j in range(1, count + 1):
        free, forced = A @ free, A @ forced
        forced[:, (j - 1) * p : j * p] += B
        across = np.sqrt(beta) * (np.eye(2) - np.outer(r[j], r[j]))
        for root in (np.sqrt(alpha) * np.eye(2), across):
            rows.append(root @ C @ forced)
            wanted.append(root @ (y_d[j] - C @ free))
    rows.append(np.sqrt(rho) * np.eye(count * p))
    wanted.append(np.zeros(count * p))
    actual = np.linalg.lstsq(np.vstack(rows), np.concatenate(wanted), rcond=None)[0]
    return actual.reshape(count, p)


def test_a_run_of_one_block_is_the_optimum_of_the_whole_path(two_axes):
    reference = arc(6, 8, two_axes)
    actual = simulate(two_axes, BlockwiseLQ(two_axes, WEIGHTS, 8), reference)
    wanted = least_squares_controls(two_axes, reference, np.asarray(actual.state)[0])
    np.testing.assert_allclose(actual.control, wanted[:6], rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_a_terminal_of_ones_own_reaches_every_block(two_axes):
    """The last step of every block sees N_p samples, as a receding horizon does."""
    reference = arc(7, 3, two_axes)
    plans = [
        law(two_axes, WEIGHTS, 3, RiccatiTerminal()).prepare(reference)
        for law in (BlockwiseLQ, ContouringLQ)
    ]
    for actual, wanted in zip(*map(jax.tree.leaves, plans), strict=True):
        np.testing.assert_allclose(actual[::3], wanted[::3], rtol=1e-10, atol=1e-12)
        assert np.abs(actual[1] - wanted[1]).max() > 1e-3 * np.abs(wanted[1]).max()


def test_a_stage_profile_is_refused(two_axes):
    with pytest.raises(ValueError, match="stage: .*no stage profile"):
        BlockwiseLQ(two_axes, LQWeights(0.7, 3.0, 0.2, [1.0, 1.0]), 2)
