from dataclasses import astuple

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jcontour.linear.plant import decoupled_axes
from jcontour.plants.xy_table import X_DRIVE, Y_DRIVE, DriveParameters, FrictionXYTable, xy_table
from tests.reference_data import numbers_of

DATA = numbers_of("mpcc/reference")
DRIVES = (X_DRIVE, Y_DRIVE)


@pytest.mark.parametrize("dt", (0.004, 0.001))
def test_matrices_are_the_reference_ones(dt):
    plant, reference = xy_table(dt), DATA["plant"][f"zoh_{dt}"]
    np.testing.assert_allclose(plant.A, reference["A"], rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(plant.B, reference["B"], rtol=1e-10, atol=1e-13)
    assert decoupled_axes(plant.pattern) == (
        (tuple(range(4)), (0,), (0,)),
        (tuple(range(4, 8)), (1,), (1,)),
    )


@pytest.mark.parametrize("drive, axis", [(X_DRIVE, "x"), (Y_DRIVE, "y")])
def test_viscous_friction_caps_the_speed(drive, axis):
    limits = DATA["limits"][axis]
    torque = 0.5 * drive.torque_constant * drive.pitch
    np.testing.assert_allclose(
        torque / (drive.motor_viscous + drive.load_viscous),
        limits["max_steady_speed_m_s"],
        rtol=1e-12,
    )
    np.testing.assert_allclose(
        torque / (drive.motor_inertia + drive.load_inertia), limits["max_accel_m_s2"], rtol=1e-12
    )
    plant, state = xy_table(0.004, (drive,)), np.zeros(4)
    for _ in range(500):
        before, state = state, np.asarray(plant.step(state, np.array([0.5])))
    assert float((plant.output(state) - plant.output(before))[0]) / 0.004 == pytest.approx(
        limits["max_steady_speed_m_s"], rel=1e-9
    )


def test_friction_plant_against_an_integrator():
    plant = FrictionXYTable(0.004, load_torque=(0.03, -0.01))
    state, control = np.array([1.0, 2.0, 1.1, -0.3, 0.0, -5.0, 0.2, 0.1]), np.array([0.3, -0.2])

    def rates(_, x):
        out = []
        for i, (d, load) in enumerate(zip(DRIVES, (0.03, -0.01), strict=True)):
            psi, dpsi, phi, dphi = x[4 * i : 4 * i + 4]
            link = d.stiffness * (phi - psi) + d.damping * (dphi - dpsi)
            motor = (
                d.torque_constant * control[i]
                + link
                - d.motor_viscous * dpsi
                - 0.010 * np.tanh(dpsi / 0.5)
            )
            out += [
                dpsi,
                motor / d.motor_inertia,
                dphi,
                (-link - d.load_viscous * dphi - 0.020 * np.tanh(dphi / 0.5) - load)
                / d.load_inertia,
            ]
        return out

    exact = solve_ivp(rates, (0.0, 0.004), state, rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(
        plant.step(state, control), exact, rtol=0, atol=0.05
    )  # first order in the substep
    scale = np.abs(exact - state).max()
    assert np.abs(plant.step(state, control) - exact).max() < 1e-2 * scale


def test_without_friction_the_table_is_linear():
    free, linear = FrictionXYTable(0.004, motor_coulomb=0.0, load_coulomb=0.0), xy_table(0.004)
    state, control = np.arange(1.0, 9.0), np.array([0.2, -0.4])
    np.testing.assert_allclose(free.step(state, control), linear.step(state, control), rtol=1e-11)
    np.testing.assert_allclose(free.output(state), linear.output(state))
    np.testing.assert_allclose(free.measure(state), state)


def test_rest_stays_and_the_derivative_is_finite_there():
    plant = FrictionXYTable(0.001)
    rest = plant.initial_state(np.array([0.04, -0.01]), np.zeros(2))
    np.testing.assert_allclose(plant.output(rest), [0.04, -0.01], rtol=1e-14)
    np.testing.assert_allclose(plant.step(rest, np.zeros(2)), rest, rtol=0, atol=1e-9)
    slope = jax.jit(jax.jacfwd(lambda state: plant.step(state, np.zeros(2))))(rest)
    assert np.isfinite(np.asarray(slope)).all()


def test_scaled_machines():
    scaled = X_DRIVE.scaled(inertia=1.1, viscous=1.2, link=0.9, torque=0.8)
    expected = (2.53e-5, 2.31e-5, 1.668e-4, 1.2e-3, 2.40138, 4.5e-4, 0.34912, 0.7958e-3)
    np.testing.assert_allclose(astuple(scaled), expected, rtol=1e-12)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: DriveParameters(0.0, 1.0, 1.0, 1.0, 1.0, 1.0), "motor_inertia"),
        (lambda: DriveParameters(1.0, 1.0, -1.0, 1.0, 1.0, 1.0), "motor_viscous"),
        (lambda: xy_table(0.0), "dt"),
        (lambda: FrictionXYTable(1.3e-5), "dt"),
        (lambda: FrictionXYTable(float("nan")), "dt"),
        (lambda: FrictionXYTable(0.004, motor_coulomb=-1.0), "motor_coulomb"),
    ],
)
def test_bad_input_is_one_line(make, words):
    with pytest.raises(ValueError, match=words):
        make()
