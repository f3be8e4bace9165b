import numpy as np
import pytest
from scipy.signal import lfilter

from tuning.identification.linear.noise_model import disturbance_filter, whitened, whitening

ROWS = 40_000


def test_the_filter_of_known_noise():
    """The asymptotic deviation of an AR coefficient of order p at the truth is below 1/sqrt(N)."""
    white = np.random.default_rng(0).standard_normal(ROWS)
    coloured = np.asarray(lfilter([1.0], [1.0, -1.6, 0.8], white))
    w = whitening(coloured, 12)
    wanted = np.zeros(len(w))
    wanted[:3] = 1.0, -1.6, 0.8
    assert np.abs(w - wanted).max() < 5 / np.sqrt(ROWS)
    assert np.var(whitened(coloured, w)) == pytest.approx(1.0, rel=5 * np.sqrt(2 / ROWS))


def test_a_drift_is_differenced():
    walk = np.cumsum(np.random.default_rng(1).standard_normal(ROWS))
    assert whitening(walk, 8)[1] == pytest.approx(-1.0, abs=0.02)


def test_nothing_left_needs_no_filter():
    assert np.array_equal(whitening(np.zeros(200), 5), [1.0])


def test_the_filter_before_any_model_is_right_under_feedback():
    """y = 0.9 y(-1) + u(-1) + e is a long least-squares model itself: w is its denominator."""
    random = np.random.default_rng(2)
    y, u = np.zeros(ROWS), np.zeros(ROWS)
    e, r = random.standard_normal(ROWS), random.standard_normal(ROWS)
    for k in range(1, ROWS):
        y[k] = 0.9 * y[k - 1] + u[k - 1] + e[k]
        u[k] = 0.4 * (r[k] - y[k])
    w = disturbance_filter(u, y, 6)
    assert np.abs(w - [1.0, -0.9, 0, 0, 0, 0, 0]).max() < 0.05
