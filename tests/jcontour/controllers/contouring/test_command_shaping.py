import control
import numpy as np
import pytest
from scipy.optimize import brentq

from jcontour.controllers.contouring.schemes import (
    CommandShaped,
    CrossCoupled,
    CrossGains,
    VariableCoupling,
)
from jcontour.simulation.closed_loop import simulate

GAIN = 1.5


def position_response(table, k_pp=25.0, k_pv=10.0, t_iv=0.05):
    """Frequency response y / r of one axis, closed by python-control.

    The PI is k_pv + k_pv T_s / T_iv z / (z - 1).
    """
    plant, dt = table.equal, table.dt
    A, B, C = (np.asarray(m) for m in (plant.A, plant.B, plant.C))
    A, B, C = A[:4, :4], B[:4, :1], C[:1, :4]
    axis = control.ss(A, B, np.vstack([C, [0.0, 0.7958e-3, 0.0, 0.0]]), 0, dt)  # position, velocity
    w = control.tf([k_pv + k_pv * dt / t_iv, -k_pv], [1, -1], dt)
    z = np.exp(1j * table.feed / table.radius * dt)
    position, velocity = axis(z).ravel() * w(z)
    return k_pp * position / (1 + k_pp * position + velocity)


def test_the_plain_circle_is_the_frequency_response(table):
    """Radius and lag of the tool, for the table that the other test stands on."""
    response, reference = position_response(table), table.on_circle()
    tool = np.asarray(simulate(table.equal, table.cascade(), reference).output)[-1] @ [1, 1j]
    wanted = np.asarray(reference.position)[reference.steps - 1] @ [1, 1j]
    assert tool / wanted == pytest.approx(response, abs=1e-9)


def test_steady_circle_of_equal_axes(table):
    """The command runs on a circle of R - k eps.

    The tool follows it by the frequency response: one equation for eps.
    """
    response, R = position_response(table), table.radius

    def mismatch(eps):
        return (abs(response * (R - GAIN * eps)) ** 2 - R**2) / (
            2 * R
        ) - eps  # c'e of the tool is (|y|^2 - R^2) / 2R

    expected = abs(response) * (R - GAIN * brentq(mismatch, -R / 4, R / 4, xtol=1e-16))
    found = np.linalg.norm(
        np.asarray(
            simulate(table.equal, CommandShaped(table.cascade(), GAIN), table.on_circle()).output
        )[-1]
    )
    assert found == pytest.approx(expected, abs=1e-9)
    assert abs(found - R) < 0.5 * abs(abs(response) - 1) * R


def test_steady_error_on_a_line_is_divided(table):
    """The error falls by 1 + k for equal lags, here by 1 + k sum n_i^2: e = e0 - k eps n."""
    normal, cascade = np.array([-np.sin(0.6), np.cos(0.6)]), table.cascade((18.0, 35.0))
    plain, found = (
        table.last_error(table.plant, c, table.on_line(0.6))
        for c in (cascade, CommandShaped(cascade, GAIN))
    )
    assert normal @ found == pytest.approx(normal @ plain / (1 + GAIN), rel=1e-6)


def test_is_cross_coupling_by_the_position_gain(table):
    """With equal k_pp, k on the position is k_pp k on the speed.

    The difference is kappa e / 2 in the direction.
    """
    reference = table.on_line(0.6, steps=300)
    shaped = simulate(table.plant, CommandShaped(table.cascade(), GAIN), reference)
    coupled = simulate(
        table.plant,
        CrossCoupled(table.cascade(), CrossGains(25.0 * GAIN), VariableCoupling()),
        reference,
    )
    np.testing.assert_allclose(shaped.control, coupled.control, rtol=0, atol=1e-9)
