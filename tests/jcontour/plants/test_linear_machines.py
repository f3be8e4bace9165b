"""The example drive against the series of its step response.

Servos side by side against SciPy's discretisation.
"""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete

from jcontour.linear.plant import decoupled_axes, spectral_radius
from jcontour.linear.transfer_functions import transfer_function
from jcontour.plants.linear_machines import (
    bandwidth_of_zero,
    bridgeport,
    exact_bridgeport,
    linear_motor_drive,
    servo_axes,
)
from tests.reference_data import numbers_of

PLANTS = numbers_of("mcnab/plants")


def test_matrices_are_the_reference_ones():
    plant = bridgeport()
    for name in "ABC":
        np.testing.assert_allclose(
            getattr(plant, name), PLANTS["bridgeport"][name], rtol=4e-16, atol=0
        )
    assert plant.dt == 0.5e-3


def test_two_axes_with_an_integrator_each_and_the_same_ramp_gain():
    plant = bridgeport()
    assert decoupled_axes(plant.pattern) == (((0, 1, 2), (0,), (0,)), ((3, 4, 5, 6, 7), (1,), (1,)))
    assert abs(float(spectral_radius(plant.A)) - 1.000041) < 1e-6  # the paper prints four decimals
    gains = []
    for states, inputs, outputs in decoupled_axes(plant.pattern):
        A, B = (
            np.asarray(plant.A)[np.ix_(states, states)],
            np.asarray(plant.B)[np.ix_(states, inputs)],
        )
        values, right = np.linalg.eig(A)
        left = np.linalg.inv(right)
        slow = np.argmax(np.abs(values))
        residue = (
            np.asarray(plant.C)[np.ix_(outputs, states)] @ right[:, [slow]] @ left[[slow]] @ B
        ).real.item()
        gains.append(residue / plant.dt)
        assert np.sort(np.abs(values))[-2] < 0.9
    np.testing.assert_allclose(gains, [0.02261, 0.02234], rtol=5e-3)


def determinant(rows):
    if not rows:
        return 1
    minors = ([row[:j] + row[j + 1 :] for row in rows[1:]] for j in range(len(rows)))
    return sum((-1) ** j * rows[0][j] * determinant(minor) for j, minor in enumerate(minors))


def test_exact_integrators_are_within_the_rounding_of_the_paper():
    """det(A - I) of every axis in rational numbers; for the printed matrices 1e-5 to 1e-4."""
    printed, exact = bridgeport(), exact_bridgeport()
    np.testing.assert_allclose(np.round(np.asarray(exact.A), 4), printed.A, rtol=1e-15)
    assert (
        exact.pattern == printed.pattern and np.count_nonzero(np.not_equal(exact.A, printed.A)) == 2
    )
    for name in ("B", "C", "dt"):
        np.testing.assert_array_equal(getattr(exact, name), getattr(printed, name))
    for states, _, _ in decoupled_axes(exact.pattern):
        rows = (np.asarray(exact.A)[np.ix_(states, states)]).tolist()
        lifted = [
            [Fraction(value) - (i == j) for j, value in enumerate(row)]
            for i, row in enumerate(rows)
        ]
        assert abs(determinant(lifted)) < 1e-17


LOOP = numbers_of("feedforward/alter_tsao")["explicit_loop"]


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


def sampled(gain, pole, dt):
    A, B = np.array([[0, 1], [0, -pole]]), np.array([[0], [gain]])
    return cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), dt)[:2]


@pytest.mark.parametrize(("dt", "poles"), [(2e-3, (10.0, 12.0)), (1e-2, (0.1, 300.0))])
def test_blocks_are_sampled_exactly(dt, poles):
    plant = servo_axes([50.0, 40.0], poles, dt)
    found = np.asarray(plant.A), np.asarray(plant.B)
    for axis, (gain, pole) in enumerate(zip((50.0, 40.0), poles, strict=True)):
        A, B = sampled(gain, pole, dt)
        rows = slice(2 * axis, 2 * axis + 2)
        np.testing.assert_allclose(found[0][rows, rows], A, rtol=1e-11, atol=1e-15)
        np.testing.assert_allclose(found[1][rows, axis : axis + 1], B, rtol=1e-9)
    assert np.count_nonzero(plant.A) == 6 and np.count_nonzero(plant.B) == 4


def test_one_pole_stands_for_all_axes_and_the_start_is_in_motion():
    plant = servo_axes([50.0, 40.0, 30.0], 10.0, 2e-3)
    state = plant.initial_state(np.array([1.0, 2.0, 3.0]), np.array([2e-3, 0.0, -4e-3]))
    np.testing.assert_allclose(state, [1.0, 1.0, 2.0, 0.0, 3.0, -2.0], atol=1e-12)


def test_numbers_may_be_traced():
    @jax.jit
    def reached(gain, pole):
        plant = servo_axes(gain, pole, 1e-2)
        return plant.output(plant.step(jnp.zeros(4), jnp.ones(2)))[1]

    gain, pole = np.array([50.0, 40.0]), np.array([10.0, 20.0])
    slope = jax.jit(jax.grad(reached, argnums=1))(gain, pole)
    h = np.array([0.0, 1e-4])
    difference = np.subtract(reached(gain, pole + h), reached(gain, pole - h)) / 2e-4
    np.testing.assert_allclose(slope, [0.0, difference], rtol=1e-7)


@pytest.mark.parametrize(
    ("gain", "pole", "dt"),
    [([0.0], 1.0, 1e-3), ([1.0], -1.0, 1e-3), ([1.0], 1.0, 0.0), ([np.nan], 1.0, 1e-3)],
)
def test_bad_numbers(gain, pole, dt):
    with pytest.raises(ValueError, match="needs to be finite and above zero"):
        servo_axes(gain, pole, dt)


@pytest.mark.parametrize(("gain", "pole"), [(1.0, 1.0), ([1.0, 2.0], [1.0, 2.0, 3.0])])
def test_bad_shapes(gain, pole):
    with pytest.raises(ValueError, match="one number for each axis"):
        servo_axes(gain, pole, 1e-3)
