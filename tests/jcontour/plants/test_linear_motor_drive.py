"""The example drive against the series of its step response."""

import json
from pathlib import Path

import numpy as np
import pytest

from jcontour.linear.transfer_functions import transfer_function
from jcontour.plants.linear_motor_drive import bandwidth_of_zero, linear_motor_drive

DATA = Path(__file__).parents[2] / "data" / "feedforward" / "alter_tsao.json"
LOOP = json.loads(DATA.read_text())["explicit_loop"]


def test_coefficients_are_those_of_the_series():
    found = transfer_function(linear_motor_drive())
    np.testing.assert_allclose(found.numerator, LOOP["num_lambda"], rtol=1e-8)
    np.testing.assert_allclose(found.denominator, LOOP["den_lambda"], rtol=1e-8)
    np.testing.assert_allclose(found.zeros, LOOP["zeros_lambda"], rtol=1e-8)


def test_bandwidth_of_the_zero():
    assert bandwidth_of_zero(-0.3075) == pytest.approx(LOOP["p_rad_s"], rel=1e-8)
    wanted = LOOP["alternative_p_for_s(s+20)(s+p)"]
    assert bandwidth_of_zero(-0.3075, drag=20.0) == pytest.approx(wanted, rel=1e-8)


def test_a_step_of_the_continuous_drive():
    p, c, dt = 800.0, 20.0, 5e-4
    plant = linear_motor_drive(p, c, dt)
    state = np.zeros(3)
    for _ in range(40):
        state = np.asarray(plant.step(state, np.ones(1)))
    t = 40 * dt
    a = 1 - np.exp(-p * t)
    v = 1 / c + np.exp(-p * t) / (p - c) - np.exp(-c * t) * (1 / c + 1 / (p - c))
    y = (
        t / c
        + (1 - np.exp(-p * t)) / (p * (p - c))
        - (1 - np.exp(-c * t)) / c * (1 / c + 1 / (p - c))
    )
    np.testing.assert_allclose(state, [y, v, a], rtol=1e-10)


def test_bad_input():
    with pytest.raises(ValueError, match="bandwidth"):
        linear_motor_drive(-1.0)
    with pytest.raises(ValueError, match="drag"):
        linear_motor_drive(100.0, -1.0)
    with pytest.raises(ValueError, match="no bandwidth"):
        bandwidth_of_zero(-0.1)
