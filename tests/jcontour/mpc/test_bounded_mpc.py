"""The bounded MPC along a run, on a slide whose mass changes on the way."""

import numpy as np
import pytest

from jcontour.geometry.contours import line
from jcontour.motion.references import from_samples
from jcontour.mpc.bounded_mpc import BoundedMPC, KeptRows
from jcontour.qp.problem import Unsolved
from jcontour.sets.least_peaks import least_peak
from jcontour.sets.responses import DisturbedModel, VaryingModel, brought_to_rest_along

DT, LENGTH, STEPS = 0.1, 8, 60
SAMPLES = STEPS + 2 * LENGTH
SPARE = 1.02


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def model(late: int) -> tuple[VaryingModel, np.ndarray]:
    """Slides of 1 and 1.1 kg in turn, ten samples each, under 0.3 N."""
    which = np.arange(SAMPLES) // 10 % 2
    mass = np.where(which == 1, 1.1, 1.0)[:, None, None]
    A = np.broadcast_to([[1, DT], [0, 1]], (SAMPLES, 2, 2))
    B = np.array([[DT**2 / 2], [DT]]) / mass
    actual = VaryingModel(A, B, 0.3 * B)
    for _ in range(late):
        actual = actual.with_input_delay()
    return actual, which


def made(late: int = 0, limit: float | None = None, control_limit: float | None = None):
    """The controller around rest; the tube of its states is hardly wider than it has to be."""
    actual, which = model(late)
    n = actual.A.shape[1]
    patterns = []
    for k in (0, 10):
        one = DisturbedModel.of(actual.A[k], actual.B[k], actual.E[k])
        tool = one.state_signals(["x"], np.eye(n)[0])
        patterns.append(least_peak(one, tool, one.control_signals(1.2), LENGTH).response)
    response = brought_to_rest_along(actual, patterns, which)
    R = response.samples
    rows = np.broadcast_to(np.eye(n), (R, n, n))
    sizes = SPARE * response.growth(rows, np.zeros((R, n, 1)))[..., -1].max(axis=0)
    if limit is not None:
        sizes[0] = limit
    names = tuple("xvu"[:n])
    kept = KeptRows(names, rows, np.zeros((R, n)), np.broadcast_to(sizes, (R, n)))
    each = np.ones((R, 1, 1))
    most = SPARE * response.growth(np.zeros((R, 1, n)), each)[..., -1].max()
    still = np.zeros((R, n)), np.zeros((R, 1))
    limits = np.full((R, 1), most if control_limit is None else control_limit)
    return BoundedMPC(*still, response, kept, limits, late), float(sizes[0])


@pytest.fixture(scope="module")
def rest():
    zeros = np.zeros((SAMPLES, 1))
    path = line([-1.0], [1.0])
    return from_samples(zeros, zeros + 1.0, DT, 2 * LENGTH, contour=path, in_motion=False)


def run(mpc: BoundedMPC, reference, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (T, n) and controls (T, 1); a QP without an answer raises."""
    plan, memory = mpc.prepare(reference), mpc.initial_memory(reference)
    actual, x, states, controls = mpc.response.model, np.zeros(mpc.state.shape[1]), [], []
    for k in range(reference.steps):
        row = type(plan)(*(leaf[k] for leaf in plan))
        memory, u, report = mpc.step(memory, row, x[:2])
        assert report.residual < 1e-8
        states.append(x)
        controls.append(u)
        x = actual.A[k] @ x + actual.B[k] @ u + actual.E[k] @ w[k]
    return np.array(states), np.array(controls)


@pytest.mark.parametrize("late", [0, 1])
def test_it_keeps_its_promise_over_the_switches(late, rest, rng):
    mpc, size = made(late)
    laps = [np.sign(rng.normal(size=(STEPS, 1))) for _ in range(3)]
    laps += [np.where(np.arange(STEPS)[:, None] // 9 % 2, 1.0, -1.0)]
    for w in laps:
        states, controls = run(mpc, rest, w)
        assert np.abs(states[:, 0]).max() <= size * (1 + 1e-8)
        assert np.abs(controls).max() <= mpc.control_limit.max() * (1 + 1e-8)


@pytest.mark.parametrize("late", [0, 1])
def test_its_attack_comes_near_to_it(late, rest):
    mpc, size = made(late)
    end = LENGTH + int(np.argmax(mpc.needs[LENGTH:STEPS, 0]))
    w = np.zeros((STEPS, 1))
    w[end - LENGTH : end] = mpc.response.attack(np.eye(mpc.state.shape[1])[0], end)
    states, _ = run(mpc, rest, w)
    assert 0.85 * size < np.abs(states[:, 0]).max() <= size * (1 + 1e-8)


def test_undisturbed_it_drives_the_nominal_control(rest):
    mpc, _ = made()
    _, controls = run(mpc, rest, np.zeros((STEPS, 1)))
    np.testing.assert_allclose(controls, 0.0, atol=1e-9)


def test_what_the_run_takes_of_a_limit_is_left_on_one_side_only(rest):
    """A value of 0.3 of a limit moves both bounds of its rows down by as much."""
    mpc, _ = made(limit=1.0)
    kept = mpc.kept._replace(value=np.where([True, False], 0.3, 0.0) + 0 * mpc.kept.value)
    mpc = BoundedMPC(mpc.state, mpc.control, mpc.response, kept, mpc.control_limit)
    plan = mpc.prepare(rest)
    middle = (plan.low + plan.high)[:, : 2 * (LENGTH - 1)].reshape(STEPS, LENGTH - 1, 2)[:, 1:] / 2
    np.testing.assert_allclose(middle, np.broadcast_to([-0.3, 0.0], middle.shape), atol=1e-12)


def test_it_says_where_a_disturbance_leaves_no_answer(rest):
    mpc, _ = made()
    with pytest.raises(Unsolved):
        run(mpc, rest, np.full((STEPS, 1), 6.0))


def test_bad_input(rest):
    with pytest.raises(ValueError, match=r"x: run and disturbances need .* the limit is 1e-06"):
        made(limit=1e-6)
    with pytest.raises(ValueError, match="control 1: run and disturbances need"):
        made(control_limit=0.1)
    with pytest.raises(ValueError, match="control_limit, kept.limit: need to be above zero"):
        made(control_limit=-1.0)
    mpc, size = made()
    with pytest.raises(ValueError, match="kept.value: needs shape"):
        short = mpc.kept._replace(value=np.zeros((3, 1)))
        BoundedMPC(mpc.state, mpc.control, mpc.response, short, mpc.control_limit)
    long = from_samples(
        np.zeros((2 * SAMPLES, 1)),
        np.ones((2 * SAMPLES, 1)),
        DT,
        2 * LENGTH,
        contour=line([-1.0], [1.0]),
        in_motion=False,
    )
    with pytest.raises(ValueError, match=r"reference: its .* steps need responses"):
        mpc.prepare(long)
