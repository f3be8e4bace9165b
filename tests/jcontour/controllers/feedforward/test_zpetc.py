"""Zero phase error tracking against the paper's digits and the reference's sweeps.

Preview filters against scipy and against steady motion in closed form.

Causal inversion of a model.
"""

import equinox as eqx
import jax
import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from jcontour.controllers.feedforward.zpetc import (
    PreviewFilter,
    ZeroPhaseTracking,
    causal,
    causal_filter,
    gain_error,
    zero_phase_filter,
)
from jcontour.geometry.contours import line
from jcontour.linear.transfer_functions import from_polynomials
from jcontour.motion.references import along, from_samples
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.linear_machines import servo_axes
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

DT, KP, POLE = 3e-3, 817.41795, 567.5  # [s], per m, [rad/s]
NUMBERS = numbers_of("feedforward/zpetc")


def plant_polynomials(gain, pole, dt):
    """Zero-order hold of k / (s (s + p)), Smith & Lee's Table 1."""
    x, e = pole * dt, np.exp(-pole * dt)
    b0 = gain * (x - 1 + e) / pole**2
    b1 = gain * (1 - e - x * e) / pole**2
    return np.array([0.0, b0, b1]), np.convolve([1.0, -1.0], [1.0, -e])


def closed_loop(gain, pole, kp, dt=DT):
    top, below = plant_polynomials(gain, pole, dt)
    return from_polynomials(kp * top, polynomial.polyadd(below, kp * top), dt)


@pytest.fixture(scope="module")
def ahead():
    return zero_phase_filter(closed_loop(16.359, POLE, KP))


def test_the_prefilter_has_the_printed_digits():
    fit = NUMBERS["fit"]
    actual = zero_phase_filter(closed_loop(16.359, fit["pole"], 1e3 * fit["kp"]))
    taps = np.asarray(actual.numerator) / np.asarray(actual.denominator)[0]
    np.testing.assert_allclose(taps, fit["prefilter"], rtol=1e-8)
    np.testing.assert_allclose(taps, NUMBERS["printed_prefilter"], atol=0.5e-4)
    assert actual.preview == 2


def test_the_response_has_no_phase(ahead):
    loop = closed_loop(16.359, POLE, KP)
    angles = np.linspace(0.01, 3.1, 50)
    points = np.exp(-1j * angles)
    filtered = polynomial.polyval(points, np.asarray(ahead.numerator)) / polynomial.polyval(
        points, np.asarray(ahead.denominator)
    )
    response = filtered * loop.response(points) / points**ahead.preview
    np.testing.assert_allclose(response.imag, 0, atol=1e-10)
    wanted = gain_error(loop, angles / DT)
    np.testing.assert_allclose(response.real - 1, wanted, atol=1e-10)
    z = 0.5736574887  # |1 + z|^2 of the paper's zero
    closed_form = (1 + 2 * z * np.cos(angles) + z**2) / (1 + z) ** 2 - 1
    np.testing.assert_allclose(wanted, closed_form, atol=1e-9)


@pytest.mark.parametrize("row", range(48))
def test_the_integral_sweep(link, ahead, row):
    wanted = NUMBERS["integral_sweep"][row]
    gain, pole = wanted["truth"]
    plant = Encoders(servo_axes([1e-3 * gain], pole, DT))
    if wanted["quantum_mm"]:
        plant = Quantised(plant, 1e-3 * wanted["quantum_mm"])
    time = np.inf if wanted["T_i"] is None else wanted["T_i"]
    controller = ZeroPhaseTracking(ahead, KP, Sensors([0]), DT, time)
    reference = link(DT, 2)
    run = simulate(plant, controller, reference)
    error = 1e6 * np.abs(np.asarray(run.output) - np.asarray(reference.position)[: reference.steps])
    assert error.mean() == pytest.approx(wanted["mae_um"], rel=1e-7)
    assert error.max() == pytest.approx(wanted["max_um"], rel=1e-7)


def test_equation_5_corrected(ahead):
    """y / y_d at 3 Hz with an integrator, on a plant with another gain."""
    wanted = NUMBERS["eq5_check_3Hz"]
    x = np.exp(-2j * np.pi * 3 * DT)
    loop = closed_loop(1.1 * 16.359, POLE, KP)
    taps = np.asarray(ahead.numerator) / np.asarray(ahead.denominator)[0]
    fed = taps @ np.array([x**-2, x**-1, 1, x])
    integral = wanted["k_I"] / (1 - x)
    through = loop.response(x)
    actual = through * (fed + integral) / (1 + through * integral)
    assert actual.real == pytest.approx(wanted["real"], rel=1e-8)
    assert actual.imag == pytest.approx(wanted["imag"], rel=1e-8)


def test_unstable_zeros_and_cancelled_ones():
    """y = |B^u|^2 / B^u(1)^2 y_d sample by sample, with a zero of each kind and a delay of two."""
    top = 0.2 * np.convolve([0.0, 0.0, 1.0], np.convolve([1.0, 1.6], [1.0, -0.4]))
    loop = from_polynomials(top, [1.0, -0.9, 0.2], DT)
    actual = zero_phase_filter(loop)
    assert actual.preview == 3
    pulse = np.eye(1, 60)[0]
    control = lfilter(np.asarray(actual.numerator), np.asarray(actual.denominator), pulse)
    output = lfilter(loop.numerator, loop.denominator, control)
    wanted = np.zeros(60)
    wanted[2:5] = np.array([1.6, 1 + 1.6**2, 1.6]) / 2.6**2
    np.testing.assert_allclose(output, wanted, atol=1e-12)


def test_bad_input(ahead):
    blocked = from_polynomials([0.0, 1.0, -1.0], [1.0, -0.5], DT)
    with pytest.raises(ValueError, match="zero at z = 1"):
        zero_phase_filter(blocked)
    with pytest.raises(ValueError, match="gain"):
        ZeroPhaseTracking(ahead, 0.0, Sensors([0]), DT)
    with pytest.raises(ValueError, match="integral_time"):
        ZeroPhaseTracking(ahead, 1.0, Sensors([0]), DT, 0.0)


TOP, BELOW = np.array([0.5, -0.2, 0.1]), np.array([2.0, -1.0, 0.3, 0.1])


def test_causal_is_lfilter():
    samples = np.random.default_rng(0).standard_normal((40, 2))
    rows = (np.stack([TOP, -TOP]), np.stack([BELOW, BELOW]))
    actual = jax.jit(causal)(rows[0], rows[1], samples)
    wanted = np.stack(
        [lfilter(TOP, BELOW, samples[:, 0]), lfilter(-TOP, BELOW, samples[:, 1])], axis=1
    )
    np.testing.assert_allclose(actual, wanted, rtol=1e-12, atol=1e-14)


def test_it_has_been_running_before_the_first_sample():
    """The same as a filter that starts far back on the steady motion."""
    random = np.random.default_rng(1)
    start, increment = np.array([0.3, -1.0]), np.array([0.01, 0.02])
    count = np.arange(-400, 30)[:, None]
    samples = start + increment * count
    samples[401:] += random.standard_normal((29, 2))
    wanted = lfilter(TOP, BELOW, samples, axis=0)[400 + 3 :]
    still = from_samples(samples[400:], np.tile([1.0, 0.0], (30, 1)), 1e-3, 3, in_motion=False)
    reference = eqx.tree_at(lambda one: one.start_increment, still, increment)
    actual = eqx.filter_jit(PreviewFilter(TOP, BELOW, preview=3).of)(reference)
    # the long filter began with a jump 400 samples ago
    np.testing.assert_allclose(actual, wanted, rtol=1e-10, atol=1e-10)


def test_an_advance_is_the_reference_ahead():
    reference = along(line([0.0], [1.0]), 1e-3 * np.arange(9), 1e-3, preview=4, at_rest=False)
    actual = eqx.filter_jit(PreviewFilter([1.0], [1.0], preview=2).of)(reference)
    np.testing.assert_allclose(actual, np.asarray(reference.position)[2:11], atol=1e-15)


def test_bad_input_of_preview_filter():
    with pytest.raises(ValueError, match="not stable"):
        PreviewFilter([1.0], [1.0, -1.0], 0)
    with pytest.raises(ValueError, match="cannot be negative"):
        PreviewFilter([1.0], [1.0], -1)
    with pytest.raises(ValueError, match="finite"):
        PreviewFilter([np.nan], [1.0], 0)
    reference = along(line([0.0], [1.0]), 1e-3 * np.arange(9), 1e-3, preview=1, at_rest=False)
    with pytest.raises(ValueError, match="looks 2 samples ahead"):
        PreviewFilter([1.0], [1.0], 2).of(reference)


def test_plant_and_filter_leave_the_zeros_that_are_not_cancelled():
    """The stable zero is cancelled, the one outside the unit circle leaves its steady gain."""
    stable, outside = np.array([1.0, -0.4]), np.array([1.0, 1.8])
    top = np.concatenate([[0.0, 0.0], 0.3 * np.convolve(stable, outside)])
    transfer = from_polynomials(top, np.convolve([1.0, -1.0], [1.0, -0.7]), dt=1e-3)
    ahead = causal_filter(transfer)
    assert ahead.preview == 2
    lam = np.exp(-1j * np.array([0.01, 0.4, 2.5]))
    value = [np.polynomial.polynomial.polyval(lam, np.asarray(row)) for row in ahead_rows(ahead)]
    actual = transfer.response(lam) * value[0] / value[1] * lam**-2.0
    np.testing.assert_allclose(actual, (1 + 1.8 * lam) / 2.8, rtol=1e-10)


def ahead_rows(ahead):
    return ahead.numerator, ahead.denominator


def test_a_zero_at_one_is_refused():
    with pytest.raises(ValueError, match="zero at z = 1"):
        causal_filter(from_polynomials([0.0, 1.0, -1.0], [1.0, -0.5], dt=1e-3))
