"""The forms' predictions against a model that is stepped by hand."""

import numpy as np
import pytest

from jcontour.mpc.condense import predict
from jcontour.mpc.forms import AbsoluteForm, VelocityForm


@pytest.fixture(scope="module")
def drawn(coupled_plant):
    """A dense plant, the last three states of a run under a constant load, and its controls."""
    plant, random = coupled_plant(1, 5, 2), np.random.default_rng(4)
    A, B = np.asarray(plant.A), np.asarray(plant.B)
    load, controls = random.standard_normal(5), random.standard_normal((4, 2))
    states = [random.standard_normal(5)]
    for u in controls:
        states.append(A @ states[-1] + B @ u + load)
    return plant, A, B, load, controls, np.array(states)


def test_the_velocity_form_finds_a_constant_load(drawn):
    _, A, B, load, controls, states = drawn
    found = VelocityForm().disturbance(A, B, states[0], controls[0], states[1])
    np.testing.assert_allclose(found, load, rtol=0, atol=1e-12)
    first = VelocityForm().disturbance(A, B, np.full(5, np.nan), controls[0], states[1])
    assert not first.any()
    assert not AbsoluteForm().disturbance(A, B, states[0], controls[0], states[1]).any()


@pytest.mark.parametrize("horizon", [1, 3])
def test_terminal_maps_are_the_last_state_and_the_last_change(drawn, horizon):
    plant, _, _, load, controls, states = drawn
    prediction = predict(plant, horizon)
    s = np.concatenate([states[0], np.zeros(2), load])
    z = controls[:horizon].ravel()
    F, G = AbsoluteForm().terminal_maps(prediction)
    np.testing.assert_allclose(F @ s + G @ z, states[horizon], rtol=0, atol=1e-11)
    F, G = VelocityForm().terminal_maps(prediction)
    change, output = states[horizon] - states[horizon - 1], np.asarray(plant.C) @ states[horizon]
    np.testing.assert_allclose(F @ s + G @ z, np.append(change, output), rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("form", "R", "S", "says"),
    [
        (AbsoluteForm(), 0.0, 0.0, "^control, increment: every control needs a weight"),
        (VelocityForm(), 1.0, 1.0, "^control: the velocity form weighs increments only"),
        (VelocityForm(), 0.0, 0.0, "^increment: needs to be positive definite"),
    ],
)
def test_weights_that_do_not_suit(form, R, S, says):
    with pytest.raises(ValueError, match=says):
        form.check_weights(R * np.eye(2), S * np.eye(2))
