"""Finite responses: peaks against all corners of the disturbances, against simulated policies."""

from itertools import product

import numpy as np
import pytest

from jcontour.sets.least_peaks import least_peak
from jcontour.sets.responses import (
    DisturbedModel,
    Signal,
    VaryingModel,
    brought_to_rest,
    brought_to_rest_along,
)

SAMPLES, LENGTH = 40, 6
DT = 0.1


@pytest.fixture(scope="module")
def response(slide):
    controls = np.array([-3.0, 1.0, 0.4, 0.2])[:, None, None] * 0.2
    return brought_to_rest(slide, controls)


def replayed(response, disturbances):
    """State and control at every sample of the policy that answers with the responses."""
    model, x, states, controls = response.model, np.zeros(2), [], []
    for k in range(len(disturbances) + 1):
        past = range(max(0, k - response.length), k)
        u = sum((response.control[k - 1 - i] @ disturbances[i] for i in past), np.zeros(1))
        states.append(x)
        controls.append(u)
        if k < len(disturbances):
            x = model.A @ x + model.B @ u + model.E @ disturbances[k]
    return np.array(states), np.array(controls)


def test_controls_are_changed_until_the_state_rests(slide, response):
    x = slide.E
    for control in response.control:
        x = slide.A @ x + slide.B @ control
    assert np.abs(x).max() < 1e-15
    assert response.length == 4 and not response.state[-1].any()


def test_peak_is_the_largest_of_all_corners(response):
    signal = Signal("mixed", np.array([2.0, -0.3]), np.array([0.7]))
    largest = 0.0
    for signs in product((-1.0, 1.0), repeat=6):
        states, controls = replayed(response, np.array(signs)[:, None])
        largest = max(largest, float(np.abs(states @ signal.state + 0.7 * controls[:, 0]).max()))
    assert response.peak(signal) == pytest.approx(largest, rel=1e-12)


def test_the_attack_of_a_constant_model_reaches_the_peak(response):
    signal = Signal("position", np.array([1.0, 0.0]), np.zeros(1))
    states, _ = replayed(response, response.attack(signal))
    assert states[-1, 0] == pytest.approx(response.peak(signal), rel=1e-12)


def test_a_response_too_short_to_rest_is_refused(slide):
    with pytest.raises(ValueError, match="responses of 1 samples cannot be brought to rest"):
        brought_to_rest(slide, np.zeros((1, 1, 1)))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def heavy_slide(mass: float) -> DisturbedModel:
    """A mass on a spring of 9 N/m under 0.2 N, forward Euler."""
    return DisturbedModel.of(
        [[1, DT], [-9 * DT / mass, 1]], [0, DT / mass], np.array([0, 0.2 * DT / mass])
    )


def along(models: list[DisturbedModel]) -> VaryingModel:
    return VaryingModel(*(np.stack([getattr(one, name) for one in models]) for name in "ABE"))


@pytest.fixture(scope="module")
def patterns():
    return [
        least_peak(one, one.state_signals(["x"], [1, 0]), one.control_signals(1.0), LENGTH).response
        for one in (heavy_slide(1.0), heavy_slide(1.5))
    ]


@pytest.fixture(scope="module")
def switched(patterns):
    """A mass that changes at every seventh sample."""
    which = np.arange(SAMPLES) // 7 % 2
    model = along([heavy_slide(1.5 if heavy else 1.0) for heavy in which])
    return brought_to_rest_along(model, patterns, which)


def position(samples: int) -> tuple[np.ndarray, np.ndarray]:
    row = np.broadcast_to(np.array([1.0, 0.0]), (samples, 1, 2))
    return row, np.zeros((samples, 1, 1))


def test_on_a_constant_model_they_are_the_pattern(patterns):
    which = np.zeros(SAMPLES, int)
    actual = brought_to_rest_along(along([heavy_slide(1.0)] * SAMPLES), patterns, which)
    assert actual.samples == SAMPLES - LENGTH
    np.testing.assert_allclose(actual.control[5], patterns[0].control, atol=1e-12)
    np.testing.assert_allclose(actual.state[5], patterns[0].state, atol=1e-12)
    growth = actual.growth(*position(actual.samples))
    wanted = np.cumsum(np.abs(patterns[0].state[:, 0]).sum(axis=-1))
    wanted = np.concatenate([[0.0], wanted[:-1]])
    np.testing.assert_allclose(growth[LENGTH + 3, 0], wanted, atol=1e-12)


def test_before_the_first_sample_nothing_acted(switched):
    growth = switched.growth(*position(switched.samples))[:, 0]
    assert growth[0].max() == 0.0
    assert growth[2, 2] > 0 and growth[2, 2] == growth[2, -1]


def test_every_answer_ends_at_rest_over_the_switches(switched):
    model, N = switched.model, LENGTH
    for k in range(switched.samples):
        x = model.E[k]
        for j in range(N):
            x = model.A[k + 1 + j] @ x + model.B[k + 1 + j] @ switched.control[k, j]
        assert np.abs(x).max() < 1e-14


def test_the_attack_reaches_the_peak(switched):
    row, still = position(switched.samples)
    peaks = switched.growth(row, still)[:, 0, -1]
    end = 21
    w = np.zeros((switched.samples, 1))
    w[end - LENGTH : end] = switched.attack(row[end, 0], end)
    assert driven(switched, w)[0][end, 0] == pytest.approx(peaks[end], rel=1e-12)


def test_the_growth_of_a_signal_is_the_sum_of_its_answers_to_every_sample(switched, rng):
    """Rows that change with time, of the states and of the controls."""
    R = switched.samples
    c, d = rng.normal(size=(R, 1, 2)), rng.normal(size=(R, 1, 1))
    answers = []
    for w in np.eye(R):
        states, controls = driven(switched, w[:, None])
        answers.append(np.sum(c[:, 0] * states, axis=1) + np.sum(d[:, 0] * controls, axis=1))
    wanted = np.abs(answers).sum(axis=0)
    own = np.abs(np.diag(answers))  # a sample's own disturbance acts after it
    assert own.max() == 0.0
    np.testing.assert_allclose(switched.growth(c, d)[:, 0, -1], wanted, rtol=1e-12, atol=1e-15)


def driven(actual, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and controls under the policy u(k) = sum_j U_(k-1-j)j w(k-1-j)."""
    model, x, states, controls = actual.model, np.zeros(2), [], []
    for k in range(actual.samples):
        states.append(x)
        u = sum(
            (actual.control[k - 1 - j, j] @ w[k - 1 - j] for j in range(min(k, LENGTH))),
            start=np.zeros(1),
        )
        controls.append(u)
        x = model.A[k] @ x + model.B[k] @ u + model.E[k] @ w[k]
    return np.array(states), np.array(controls)


def test_a_late_control_waits_in_the_state(switched, rng):
    model = switched.model
    late = model.with_input_delay()
    x, line = rng.normal(size=2), rng.normal(size=1)
    u, w = rng.normal(size=1), rng.normal(size=1)
    actual = late.A[3] @ np.append(x, line) + late.B[3] @ u + late.E[3] @ w
    wanted = model.A[3] @ x + model.B[3] @ line + model.E[3] @ w
    np.testing.assert_allclose(actual, np.append(wanted, u), atol=1e-15)


def test_bad_input(patterns):
    short = along([heavy_slide(1.0)] * LENGTH)
    with pytest.raises(ValueError, match="model: needs more than 6 samples"):
        brought_to_rest_along(short, patterns, np.zeros(LENGTH, int))
    fixed = along([heavy_slide(1.0)] * SAMPLES)
    stuck = fixed._replace(B=np.zeros_like(fixed.B))
    with pytest.raises(ValueError, match="cannot be brought to rest"):
        brought_to_rest_along(stuck, patterns, np.zeros(SAMPLES, int))


def test_disturbances_are_put_side_by_side(slide):
    wide = slide.with_disturbance([0.5, 0.7])
    np.testing.assert_array_equal(wide.E[:, 1], [0.5, 0.7])
    assert wide.disturbances == 2


def test_signals_have_a_limit_each_or_one_for_all(slide):
    rows = slide.state_signals(["x", "v"], np.eye(2), [1.0, 2.0])
    assert [(row.name, row.limit) for row in rows] == [("x", 1.0), ("v", 2.0)]
    (control,) = slide.control_signals(4.0)
    assert control.name == "control" and control.control.tolist() == [1.0]
    two = DisturbedModel.of(np.eye(2), np.eye(2), np.eye(2)).control_signals([1.0, 2.0])
    assert [row.name for row in two] == ["control 1", "control 2"]


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        (([[1.0, 2.0]], [1.0], [1.0]), "A: needs to be square"),
        ((np.eye(2), [1.0], [1.0, 0.0]), r"B: needs shape \(2, p\)"),
        ((np.eye(2), [1.0, 1.0], [[1.0]]), r"E: needs shape \(2, q\)"),
        ((np.eye(2), [1.0, np.nan], [1.0, 0.0]), "B: every entry needs to be finite"),
    ],
)
def test_bad_matrices_are_named(matrices, message):
    with pytest.raises(ValueError, match=message):
        DisturbedModel.of(*matrices)
