"""The P-type law against reference numbers and against its own filter by SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import convolve1d

from jcontour._arrays import placed
from jcontour.controllers.learning.laps import (
    Lap,
    PType,
    diverged_lap,
    learn,
    smoothed,
    smoothing_of,
)


def first_order(u, lap):
    """The plant y(k+1) = 0.5 y(k) + 0.5 u(k) of the reference numbers."""
    wanted = jnp.sin(2 * jnp.pi * jnp.arange(1.0, 51.0) / 50)[:, None]
    _, y = jax.lax.scan(lambda y, u: ((y + u) / 2,) * 2, jnp.zeros(1), u)
    return Lap(u, wanted - y, y, u)


def trials(gain, laps):
    found, _ = learn(first_order, PType(gain), laps, placed(np.zeros((50, 1))))
    return np.abs(np.asarray(found.error)).max(axis=(1, 2))


@pytest.mark.parametrize("gain", ["1.0", "2.0", "3.0"])
def test_trials_are_those_of_the_reference(companions, gain):
    wanted = companions["ilc_p_type"][gain]
    np.testing.assert_allclose(trials(float(gain), 12), wanted, rtol=1e-8)


def test_a_gain_that_diverges_is_found_at_its_lap(companions):
    errors = trials(4.2, 20)
    wanted = companions["ilc_p_type_divergent_gain_4.2_trial_20"]
    np.testing.assert_allclose(errors[-1], wanted, rtol=1e-8)
    assert diverged_lap(errors) == 2
    assert diverged_lap(companions["ilc_p_type"]["3.0"]) == diverged_lap(trials(3.0, 12)) == 3
    assert diverged_lap(trials(1.0, 12)) is None


def test_the_filter_is_a_convolution_with_held_ends():
    signal = np.random.default_rng(0).standard_normal((30, 2))
    wanted = signal
    for _ in range(5):
        wanted = convolve1d(wanted, [0.25, 0.5, 0.25], axis=0, mode="nearest")
    np.testing.assert_allclose(smoothed(placed(signal), 5), wanted, rtol=0, atol=1e-15)


@pytest.mark.parametrize("frequency", [5.0, 50.0, 200.0])
def test_the_filter_halves_the_amplitude_at_its_bandwidth(frequency):
    times = smoothing_of(2 * np.pi * frequency, 1e-3)
    wave = np.cos(2 * np.pi * frequency * 1e-3 * np.arange(4001))
    found = np.asarray(smoothed(placed(wave[:, None]), times))[2000, 0]
    assert found == pytest.approx(0.5 * wave[2000], abs=0.08)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"gain": -1.0}, "gain: needs to be finite and at least zero"),
        ({"gain": 0.5, "lead": -1}, "lead: needs a whole number"),
        ({"gain": 0.5, "smoothing": 1.5}, "smoothing: needs a whole number"),
    ],
)
def test_bad_input(any_type, arguments, says):
    with pytest.raises(ValueError, match=says):
        PType(**arguments)


def test_a_lead_longer_than_the_lap():
    with pytest.raises(ValueError, match="lead: 9 samples are more than the lap of 5 has"):
        PType(0.5, lead=9).update(*map(placed, np.zeros((2, 5, 1))))


@pytest.mark.parametrize("bandwidth", [0.0, 4000.0])
def test_bad_bandwidths(bandwidth):
    with pytest.raises(ValueError, match="bandwidth: needs to be above zero and below 3142 rad/s"):
        smoothing_of(bandwidth, 1e-3)
