"""Tuned inverses against the design on the host, their conditions, and differences."""

import jax
import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from jcontour.controllers.feedforward.model_following import ModelFollowing, optimal_feedforward
from jcontour.controllers.feedforward.tuned_inverse import (
    OptimalInverse,
    optimal_filter,
    zero_phase_inverse,
)
from jcontour.controllers.feedforward.zpetc import zero_phase_filter
from jcontour.linear.transfer_functions import from_polynomials, transfer_function
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.linear_machines import bridgeport, linear_motor_drive

DT = 1e-3
POINTS = np.exp(-1j * np.linspace(0.05, 3.1, 40))


def worked_out(inverse, *numbers):
    """Polynomials of an inverse, and its taps."""

    @jax.jit
    def both(*numbers):
        return inverse.polynomials(*numbers), inverse.solved(*numbers)[1]

    return jax.device_get(both(*numbers))


def plants():
    top = np.concatenate([[0.0], polynomial.polyfromroots([-0.4, 0.7, -2.5])])
    two_unstable = from_polynomials(0.1 * top, polynomial.polyfromroots([1.3, 1.8, 2.5, 3.0]), DT)
    delayed = with_input_delay(bridgeport(), 1)
    return {
        "linear motor": transfer_function(linear_motor_drive()),
        "two unstable zeros": two_unstable,
        "delayed Bridgeport": transfer_function(delayed, 1, 1),
    }


@pytest.mark.parametrize("name", plants())
@pytest.mark.parametrize("numbers", [(1, 4, 2), (0, 2, 2)])
def test_at_the_paper_s_numbers_it_is_the_optimum(name, numbers):
    plant, following = plants()[name], ModelFollowing(*numbers)
    inverse = OptimalInverse(plant, following)
    wanted = optimal_feedforward(plant, following)
    (top, below), taps = worked_out(inverse, 0.25, 1.0)
    actual = polynomial.polyval(POINTS, top) / polynomial.polyval(POINTS, below)
    expected = polynomial.polyval(POINTS, wanted.numerator) / polynomial.polyval(
        POINTS, wanted.denominator
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9)
    assert np.abs(taps).sum() == pytest.approx(wanted.optimum.cost, rel=1e-9)


@pytest.mark.parametrize("name", plants())
def test_at_other_numbers_it_still_inverts(name):
    """P F = R - T E' sample by sample."""
    plant, q, rho = plants()[name], 0.1, 0.97
    inverse = OptimalInverse(plant, ModelFollowing(1, 4, 2))
    (top, below), values = worked_out(inverse, q, rho)
    taps = np.zeros(max(inverse.taps) + 1)
    taps[list(inverse.taps)] = values
    response = np.array([0, 0, 0, q, 1 - 2 * q, q])
    wanted = polynomial.polysub(response, np.convolve([1, -2 * rho, rho**2], taps))
    pulse = np.eye(1, 80)[0]
    control = lfilter(top, below, pulse)
    output = lfilter(plant.numerator, plant.denominator, control)
    np.testing.assert_allclose(output[: wanted.size], wanted, atol=1e-9)
    np.testing.assert_allclose(output[wanted.size :], 0, atol=1e-6)


def test_zero_phase_without_a_model_is_the_plain_one():
    plant = plants()["delayed Bridgeport"]
    actual, plain = zero_phase_inverse([plant], 0.0), zero_phase_filter(plant)
    assert actual.preview == plain.preview + 1
    ratio = polynomial.polyval(POINTS, np.asarray(actual.numerator)[0]) / polynomial.polyval(
        POINTS, np.asarray(plain.numerator)
    )
    np.testing.assert_allclose(ratio, POINTS, rtol=1e-12)


def test_axes_with_different_needs_stay_together():
    one = from_polynomials([0.0, 1.0], [1.0, -0.5], DT)
    other = from_polynomials([0.0, 0.0, 0.5, 0.9], [1.0, -0.5], DT)
    actual = zero_phase_inverse([one, other], 0.0)
    assert actual.preview == 4
    pulse = np.eye(1, 40)[0]
    for plant, top, below, place in zip(
        (one, other),
        np.asarray(actual.numerator),
        np.asarray(actual.denominator),
        (4, 4),
        strict=True,
    ):
        output = lfilter(plant.numerator, plant.denominator, lfilter(top, below, pulse))
        assert np.argmax(np.abs(output)) == place
        assert output.sum() == pytest.approx(1.0)


def test_a_zero_that_rings_is_left_in_the_model():
    """P F = B^r (R - T E'), R = lambda^N_p M_0 B^r(1/lambda) / B^r(1)^2, sample by sample."""
    q, rho, ring, unstable = 0.2, 0.98, -0.9992, -3.7
    top = 2e-4 * np.array(polynomial.polymul([1, -ring], [1, -unstable]))
    plant = from_polynomials(np.append(0.0, top), np.polymul([1, -0.99], [1, -0.9]), DT)
    inverse = OptimalInverse(plant, ModelFollowing(1, 5, 2), q, rho, ringing=0.3)
    np.testing.assert_allclose(inverse.ringing_polynomial, [1, -ring], rtol=1e-9)
    (ahead, below), values = worked_out(inverse, q, rho)
    taps = np.zeros(max(inverse.taps) + 1)
    taps[list(inverse.taps)] = values
    model = np.convolve([q, 1 - 2 * q, q], [-ring, 1]) / (1 - ring) ** 2
    response = np.append(np.zeros(3), model)
    error = np.convolve([1, -2 * rho, rho**2], taps)
    wanted = np.convolve([1, -ring], polynomial.polysub(response, error))
    control = lfilter(ahead, below, np.eye(1, 200)[0])
    output = lfilter(plant.numerator, plant.denominator, control)
    np.testing.assert_allclose(output[: wanted.size], wanted, atol=1e-9)
    np.testing.assert_allclose(output[wanted.size :], 0, atol=1e-9)
    assert np.abs(control[20:]).max() < 1e-6 * np.abs(control).max()  # nothing rings


def test_a_zero_at_minus_one_rings_for_ever():
    """A mass without friction: its sampled zero is on the circle."""
    mass = from_polynomials([0.0, 0.5, 0.5], [1.0, -2.0, 1.0], DT)
    following = ModelFollowing(1, 3, 2)
    with pytest.raises(ValueError, match="on the unit circle"):
        OptimalInverse(mass, following)
    (ahead, below), _ = worked_out(_ringing(mass, following), 0.25, 1.0)
    assert below.size == 1 and np.isfinite(ahead).all()
    with pytest.raises(ValueError, match="model and the zeros that ring look 2 samples ahead"):
        _ringing(mass, ModelFollowing(1, 1, 0))


def _ringing(plant, following):
    return OptimalInverse(plant, following, ringing=0.3)


def test_taps_that_were_better_elsewhere_are_told():
    """The least cost at other numbers is that of a design made there."""
    top = np.append(0.0, polynomial.polyfromroots([0.59521345, 0.7842356]))
    plant, following = from_polynomials(top, [1.0, -0.5], DT), ModelFollowing(1, 2, 2)
    first, there = OptimalInverse(plant, following), OptimalInverse(plant, following, 0.25, 0.8)
    costs = [np.abs(np.asarray(one.solved(0.25, 0.8)[1])).sum() for one in (first, there)]
    assert first.taps != there.taps and costs[0] > 1.05 * costs[1]
    words = f"may be {costs[0]:.4g} with them and {costs[1]:.4g} with others"
    with pytest.warns(UserWarning, match=words):
        optimal_filter([first], 0.25, 0.8)
    optimal_filter([there], 0.25, 0.8)  # without a word
    optimal_filter([first], 0.25, 1.0)


def test_taps_that_cannot_meet_the_conditions_are_refused():
    """T = (1 - rho lambda)^N is zero at the plant's zero."""
    plant = from_polynomials(np.append(0.0, [0.9, -1.0]), [1.0, -0.5], DT)
    inverse = OptimalInverse(plant, ModelFollowing(1, 2, 2))
    with pytest.raises(ValueError, match="weight: at 1.11111 the taps .* cannot meet"):
        optimal_filter([inverse], 0.25, 1 / 0.9)


def test_bad_input():
    plant = plants()["delayed Bridgeport"]
    with pytest.raises(ValueError, match="needs at least the plant's delay of 2 samples"):
        OptimalInverse(plant, ModelFollowing(0, 1, 0))
    with pytest.raises(ValueError, match="on the unit circle"):
        OptimalInverse(from_polynomials([0.0, 1.0, 1.0], [1.0], DT), ModelFollowing(0, 2, 0))
