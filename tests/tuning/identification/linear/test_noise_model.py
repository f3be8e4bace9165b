import numpy as np
import pytest
from scipy.signal import lfilter

from tuning.identification.linear.noise_model import whitened, whitening

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
