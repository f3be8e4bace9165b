"""The QP of a bounded MPC against its definition, written out sample by sample."""

import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.geometry import contours
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.motion import references
from jcontour.mpc.bounded.bounded_mpc import (
    BoundedLimits,
    BoundedMPC,
    bounded_response,
    speed_signals,
)
from jcontour.sets.disturbed_model import DisturbedModel

DT, LENGTH, TOLERANCE = 0.01, 6, 2e-3


@pytest.fixture(scope="module")
def built():
    """Two slides that push each other a little, along a line at 45 degrees."""
    A = np.eye(4) + DT * np.array([[0, 1, 0, 0], [0, -3, 0, 0.2], [0, 0, 0, 1], [0, 0, 0, -2]])
    B = DT * np.array([[DT / 2, 0], [1, 0], [0, DT / 2], [0, 0.7]])
    C = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0]])
    Sy = np.array([[1.0, 0], [0, 0], [0, 1], [0, 0]])
    Sv = np.array([[0, 0], [1 / DT, 0], [0, 0], [0, 1 / DT]])
    model = LinearPlant(A, B, C, DT, motion=SteadyMotion(placed(Sy), placed(Sv)))
    limits = BoundedLimits(10.0, speed_signals(model, 1.0))
    disturbed = DisturbedModel.loaded(model, 0.5)
    least = bounded_response(model, disturbed, limits, LENGTH)
    mpc = BoundedMPC(model, least, limits, tolerance=TOLERANCE)
    path = contours.polyline([[0.0, 0.0], [1.0, 1.0]])
    arc = 1e-3 * np.arange(40)
    reference = references.along(path, arc, DT, mpc.preview, at_rest=False)
    return mpc, reference


def predicted(mpc, deviation, moves):
    """e_0..e_N under the moves (N, p) in control units."""
    A, B, _ = mpc.response.model
    states = [deviation]
    for move in moves:
        states.append(A @ states[-1] + B @ move)
    return np.array(states)


def row_of(plan, k):
    return type(plan.sample)(*(leaf[k] for leaf in plan.sample))


def test_rows_are_the_tightened_signals(built):
    mpc, reference = built
    generator = np.random.default_rng(0)
    deviation = 1e-4 * generator.normal(size=4)
    moves = generator.normal(size=(LENGTH, 2))
    plan, k = mpc.prepare(reference), 5
    qp = mpc._qp.problem(row_of(plan, k), deviation, np.zeros(2))
    values = qp.C @ (moves / 10.0).ravel()
    upper_gap = qp.upper_rows - values
    states = predicted(mpc, deviation, moves)
    frames, run = mpc._frames(reference)
    room = frames.room(TOLERANCE)
    by_hand = []
    for j in range(1, LENGTH):
        for r, direction in enumerate(frames.directions[k + j]):
            off = direction @ (run.state[k + j] + states[j])[[0, 2]]
            off -= direction @ np.asarray(reference.position)[k + j]
            by_hand.append((room[k + j, r] - frames.growth[k + j, r, j] - off) / room[k + j, r])
    np.testing.assert_allclose(upper_gap[: len(by_hand)], by_hand, atol=1e-7)
    speeds = []
    for j in range(LENGTH):
        for signal in mpc.limits.signals:
            x, u = run.state[k + j] + states[j], run.control[k + j] + moves[j]
            h = mpc.response.growth(signal.state, signal.control)[j]
            speeds.append((signal.limit - h - signal.state @ x - signal.control @ u) / signal.limit)
    rest = upper_gap[len(by_hand) : len(by_hand) + len(speeds)]
    np.testing.assert_allclose(rest, speeds, atol=1e-7)
    ends = values[-4:] - qp.upper_rows[-4:]
    np.testing.assert_allclose(ends * mpc._qp._end_units, states[-1], atol=1e-12)


def test_the_box_is_the_tightened_control(built):
    mpc, reference = built
    plan = mpc.prepare(reference)
    sample = row_of(plan, 3)
    qp = mpc._qp.problem(sample, np.zeros(4), np.zeros(2))
    growth = mpc.response.growth(np.zeros((2, 4)), np.eye(2))
    for j in range(LENGTH):
        most = 10.0 - growth[:, j] - sample.control[j]
        np.testing.assert_allclose(10 * qp.upper[2 * j : 2 * j + 2], most, atol=1e-6)


def test_the_cost_is_the_sum_of_its_definition(built):
    """Up to a constant and one scale: differences of values are compared."""
    mpc, reference = built
    generator = np.random.default_rng(1)
    deviation, w = 1e-4 * generator.normal(size=4), generator.uniform(-1, 1, size=2)
    sample = row_of(mpc.prepare(reference), 2)
    qp = mpc._qp.problem(sample, deviation, w)
    X, U, weights = mpc.response.state, mpc.response.control, mpc.weights

    def cost(moves):
        states, total = predicted(mpc, deviation, moves), 0.0
        for j in range(LENGTH):
            du = (moves[j] + U[:j].sum(axis=0) @ w) / 10.0
            total += weights.control * du @ du
            if j > 0:
                off = (states[j] + X[:j].sum(axis=0) @ w)[[0, 2]] / TOLERANCE
                across = sample.directions[j - 1, -1] @ off
                total += weights.output * off @ off + weights.contour * across**2
        return total

    trials = generator.normal(size=(4, LENGTH, 2))
    ours = [0.5 * z @ qp.H @ z + qp.g @ z for z in (trials / 10).reshape(4, -1)]
    theirs = [cost(moves) for moves in trials]
    scale = (theirs[1] - theirs[0]) / (ours[1] - ours[0])
    for k in (2, 3):
        assert theirs[k] - theirs[0] == pytest.approx(scale * (ours[k] - ours[0]), rel=1e-9)


def test_softened_rows_give_way_and_the_control_does_not(built):
    mpc, reference = built
    plan = mpc.prepare(reference)
    far = np.array([0.05, 0, 0.05, 0])  # 25 tolerances off
    qp = mpc._qp.softened(row_of(plan, 4), far, np.zeros(2))
    found = mpc.solver.solve(qp)
    assert mpc._qp.slack(found) > 1
    assert np.abs(mpc._qp.control(row_of(plan, 4), found)).max() <= 10.0
    near = mpc._qp.softened(row_of(plan, 4), np.zeros(4), np.zeros(2))
    assert mpc._qp.slack(mpc.solver.solve(near)) < 1e-9
