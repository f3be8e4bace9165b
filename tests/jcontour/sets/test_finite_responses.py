"""Peaks of finite responses against the largest value over all corners of the disturbances."""

from itertools import product

import numpy as np
import pytest

from jcontour.sets.disturbed_model import Signal
from jcontour.sets.finite_responses import FiniteResponse, brought_to_rest

NOTHING = np.zeros((0, 2))


@pytest.fixture(scope="module")
def response(slide):
    controls = np.array([-3.0, 1.0, 0.4, 0.2])[:, None, None] * 0.2
    return brought_to_rest(slide, controls, NOTHING)


def run(response, disturbances):
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


def test_a_sum_of_the_state_is_made_to_vanish(slide):
    found = brought_to_rest(slide, np.zeros((5, 1, 1)), np.array([[1.0, 0.0]]))
    assert abs(found.state[:, 0].sum()) < 1e-15 and np.abs(found.state[:, 0]).max() > 1e-3


def test_peak_is_the_largest_of_all_corners(response):
    signal = Signal("mixed", np.array([2.0, -0.3]), np.array([0.7]))
    largest = 0.0
    for signs in product((-1.0, 1.0), repeat=6):
        states, controls = run(response, np.array(signs)[:, None])
        largest = max(largest, float(np.abs(states @ signal.state + 0.7 * controls[:, 0]).max()))
    assert response.peak(signal) == pytest.approx(largest, rel=1e-12)


def test_the_attack_reaches_the_peak(response):
    signal = Signal("position", np.array([1.0, 0.0]), np.zeros(1))
    states, _ = run(response, response.attack(signal))
    assert states[-1, 0] == pytest.approx(response.peak(signal), rel=1e-12)


def test_growth_adds_up_to_the_peak(response):
    rows, controls = np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([[0.0], [0.5]])
    growth = response.growth(rows, controls)
    assert growth.shape == (2, 5) and not growth[:, 0].any()
    assert (np.diff(growth, axis=1) >= 0).all()
    by_hand = sum(np.abs(response.state[j, 1] + 0.5 * response.control[j, 0]) for j in range(4))
    assert growth[1, -1] == pytest.approx(by_hand.sum())


def test_a_response_too_short_to_rest_is_refused(slide):
    with pytest.raises(ValueError, match="1 samples cannot be brought to rest"):
        brought_to_rest(slide, np.zeros((1, 1, 1)), NOTHING)


def test_a_response_is_a_value(response):
    same = FiniteResponse(response.model, response.state, response.control)
    assert same.peak(Signal("v", np.array([0.0, 1.0]), np.zeros(1))) > 0
