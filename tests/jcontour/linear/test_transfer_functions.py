"""Transfer functions against python-control, closed forms and polynomials."""

import control
import numpy as np
import pytest
from numpy.polynomial import polynomial

from jcontour.linear.plant import LinearPlant
from jcontour.linear.transfer_functions import (
    from_polynomials,
    polynomial_from_zeros,
    sorted_zeros,
    transfer_function,
)
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.linear_machines import bridgeport, linear_motor_drive
from jcontour.plants.xy_table import xy_table

MACHINES = {
    "bridgeport": bridgeport,
    "delayed bridgeport": lambda: with_input_delay(bridgeport(), 2),
    "X-Y table": lambda: xy_table(1e-3),
    "linear motor": linear_motor_drive,
}


@pytest.fixture(scope="module", params=MACHINES)
def machine(request):
    return MACHINES[request.param]()


def by_control(plant, axis):
    """One axis of a decoupled machine, without the states of the others."""
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    reached = np.linalg.matrix_power(np.abs(A) + np.eye(len(A)), len(A)) @ np.abs(B[:, axis]) > 0
    return control.ss(
        A[np.ix_(reached, reached)], B[reached][:, [axis]], C[[axis]][:, reached], 0, plant.dt
    )


def test_response_zeros_and_poles_of_every_axis(machine):
    for axis in range(machine.axes):
        actual, wanted = transfer_function(machine, axis, axis), by_control(machine, axis)
        angles = np.logspace(-5, np.log10(0.999 * np.pi), 50)
        response = wanted(np.exp(1j * angles))
        np.testing.assert_allclose(actual.response(np.exp(-1j * angles)), response, rtol=1e-9)
        for ours, theirs, tolerance in (
            (actual.zeros_z, control.zeros(wanted), 1e-9),
            (actual.poles_z, control.poles(wanted), 1e-7),  # the delay's pole is double
        ):
            assert ours.size == theirs.size
            nearest = np.abs(ours[:, None] - theirs).min(axis=1)
            np.testing.assert_allclose(nearest / (1 + np.abs(ours)), 0, atol=tolerance)
        ratio = polynomial.polyval(np.exp(-1j * angles), actual.numerator) / polynomial.polyval(
            np.exp(-1j * angles), actual.denominator
        )
        near_the_integrator = 1e-4 < angles  # where coefficients cancel
        np.testing.assert_allclose(
            ratio[near_the_integrator], response[near_the_integrator], rtol=1e-6
        )


def test_impulse_response_of_a_coupled_plant(coupled_plant):
    plant = coupled_plant(3, 5, 2)
    actual = transfer_function(plant, 1, 0)
    state, samples = np.asarray(plant.B)[:, 0], [0.0]
    for _ in range(11):
        samples.append(float(np.asarray(plant.C)[1] @ state))
        state = np.asarray(plant.A) @ state
    pulse = np.zeros(12)
    padded = np.zeros(12)
    padded[: actual.numerator.size] = actual.numerator
    for k in range(12):  # den * pulse = num
        fed = sum(
            actual.denominator[j] * pulse[k - j]
            for j in range(1, actual.denominator.size)
            if j <= k
        )
        pulse[k] = padded[k] - fed
    np.testing.assert_allclose(pulse, samples, rtol=1e-9, atol=1e-12)


def test_modes_that_are_not_seen_leave():
    plain = LinearPlant([[0.5]], [[2.0]], [[3.0]], 1e-3)
    A = np.array([[0.5, 0.0, 0.0], [0.0, 0.9, 0.0], [1.0, 0.0, 0.7]])
    hidden = LinearPlant(A, [[2.0], [0.0], [0.0]], [[3.0, 1.0, 0.0]], 1e-3)
    actual = transfer_function(hidden)
    np.testing.assert_allclose(actual.poles_z, transfer_function(plain).poles_z, rtol=1e-12)
    assert actual.zeros_z.size == 0 and actual.gain == pytest.approx(6.0)


def test_zeros_are_sorted():
    zeros = np.array([0.5, -0.25, -1.6, 1.25, 1.0, 0.3 + 0.4j, 0.3 - 0.4j])
    transfer = from_polynomials(
        np.concatenate([[0.0, 0.0], np.real(polynomial.polyfromroots(zeros))]), [1.0, -0.5], 1.0
    )
    actual = sorted_zeros(transfer)
    assert transfer.delay == 2
    np.testing.assert_allclose(np.sort(actual.cancellable.real), [-1.6, 1.25], rtol=1e-9)
    np.testing.assert_allclose(actual.on_circle, [1.0], rtol=1e-9)
    assert actual.unstable.size == 4 and np.all(np.abs(actual.unstable) < 1)
    ringing = sorted_zeros(transfer, ringing=0.6)
    np.testing.assert_allclose(ringing.cancellable.real, [1.25], rtol=1e-9)
    assert ringing.unstable.size == 5
    np.testing.assert_allclose(transfer.poles_z, [0.5])


@pytest.mark.parametrize("other", [[1.0], [1.0, 0.7], [1.0, -0.7], [1.0, 1.6], [1.0, 0.2, 0.6]])
@pytest.mark.parametrize("double", [[1.0, 2.0, 1.0], [1.0, -2.0, 1.0], [1.0, -1.0, 1.0]])
def test_a_double_zero_on_the_circle_stays_there(double, other):
    """Both of its zeros, whatever stands beside it: none is left to invert, none to reflect."""
    numerator = np.convolve([0.0, *double], other)
    actual = sorted_zeros(from_polynomials(numerator, [1.0, -0.9], 1.0))
    assert actual.on_circle.size == 2
    np.testing.assert_allclose(np.abs(actual.on_circle), 1.0, atol=1e-6)
    wanted = 1 / np.roots(other)
    assert np.sum(np.abs(wanted) > 1) == actual.cancellable.size
    assert np.sum(np.abs(wanted) < 1) == actual.unstable.size


def test_a_zero_that_is_only_near_the_circle_is_told_from_it():
    """Ten times the tolerance to either side."""
    for zero_z, where in ((1 - 1e-5, "cancellable"), (1 + 1e-5, "unstable")):
        actual = sorted_zeros(from_polynomials([0.0, 1.0, -zero_z], [1.0, -0.9], 1.0))
        assert getattr(actual, where).size == 1


def test_polynomial_from_zeros_is_one_at_the_origin():
    actual = polynomial_from_zeros(np.array([0.5 + 0.5j, 0.5 - 0.5j]))
    np.testing.assert_allclose(actual, [1.0, -2.0, 2.0], rtol=1e-14)


def test_bad_input(two_axes):
    with pytest.raises(ValueError, match="input 1 does not act on output 0"):
        transfer_function(two_axes, 0, 1)
    with pytest.raises(ValueError, match="outputs 0 to 1, received 2"):
        transfer_function(two_axes, 2, 0)
    deaf = LinearPlant([[0.5, 0.0], [0.0, 0.5]], [[1.0], [0.0]], [[0.0, 1.0]], 1e-3)
    with pytest.raises(ValueError, match="does not act"):
        transfer_function(deaf)
    with pytest.raises(ValueError, match="numerator"):
        from_polynomials([0.0], [1.0], 1.0)
    with pytest.raises(ValueError, match="denominator"):
        from_polynomials([1.0], [0.0, 1.0], 1.0)
    for name, top, below in (
        ("numerator", [], [1.0]),
        ("numerator", [0.0, np.nan], [1.0]),
        ("numerator", np.array([[1.0, 2.0]]), [1.0]),
        ("denominator", [1.0], []),
        ("denominator", [1.0], [1.0, np.inf]),
    ):
        with pytest.raises(ValueError, match=f"{name}: needs a row of finite coefficients"):
            from_polynomials(top, below, 1.0)
    with pytest.raises(ValueError, match="dt: needs to be finite and above zero"):
        from_polynomials([1.0], [1.0], 0.0)
    with pytest.raises(ValueError, match="ringing"):
        sorted_zeros(from_polynomials([1.0], [1.0], 1.0), ringing=0.0)
