"""Noise in the place of counts."""

import numpy as np
import pytest

from jcontour.app.machines.count_noise import FARTHEST, SAMPLES, rounding_noise, sensor_noise


def test_it_is_what_rounding_leaves_of_a_position_that_moves():
    """Even within half a count: its deviation is resolution / sqrt(12), and it is white."""
    noise = np.asarray(rounding_noise(2, 3e-6)) / 3e-6
    assert noise.shape == (SAMPLES, 2) and np.abs(noise).max() <= 0.5
    np.testing.assert_allclose(noise.std(axis=0), 1 / np.sqrt(12), rtol=0.03)
    assert np.abs(noise.mean(axis=0)).max() < 4 / np.sqrt(12 * SAMPLES)
    correlation = np.mean(noise[1:] * noise[:-1], axis=0) * 12
    assert np.abs(correlation).max() < 4 / np.sqrt(SAMPLES)
    assert abs(np.mean(noise[:, 0] * noise[:, 1])) * 12 < 4 / np.sqrt(SAMPLES)


def test_every_position_has_its_own_count():
    mixed, fine, coarse = (
        np.asarray(rounding_noise(2, counts)) for counts in (np.array([1e-6, 5e-6]), 1e-6, 5e-6)
    )
    np.testing.assert_array_equal(mixed, np.stack([fine[:, 0], coarse[:, 1]], axis=1))
    assert mixed.std(axis=0) == pytest.approx(np.array([1e-6, 5e-6]) / np.sqrt(12), rel=0.03)


def test_sensors_have_white_noise_with_a_bound():
    noise = np.asarray(sensor_noise(2, np.array([3e-7, 0.0])))
    assert noise.shape == (SAMPLES, 2) and not noise[:, 1].any()
    scaled = noise[:, 0] / 3e-7
    assert np.abs(scaled).max() == pytest.approx(FARTHEST)  # of 8192 some 22 are beyond
    assert scaled.std() == pytest.approx(1.0, rel=0.03)
    assert abs(np.mean(scaled[1:] * scaled[:-1])) < 4 / np.sqrt(SAMPLES)
