import base64

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jcontour.app.reports.page.thinning import kept_samples, packed


@given(st.integers(0, 1000), st.integers(1, 4), st.integers(10, 5000))
def test_every_peak_stays_and_few_others_do(seed, count, steps):
    signals = np.abs(np.random.default_rng(seed).normal(size=(count, steps)))
    kept = kept_samples(signals, 400)
    assert kept[0] == 0 and kept[-1] == steps - 1 and np.all(np.diff(kept) > 0)
    assert len(kept) <= 402
    assert np.array_equal(signals[:, kept].max(axis=1), signals.max(axis=1))


def test_short_runs_stay_whole_and_nan_is_no_peak():
    assert kept_samples(np.ones((1, 7)), 7).tolist() == list(range(7))
    signal = np.full((1, 1000), np.nan)
    signal[0, 333] = 1.0
    assert 333 in kept_samples(signal, 20)


def test_packed_numbers_read_back():
    values = np.array([[1.5, np.nan], [-2e-9, 4e20]])
    read = np.frombuffer(base64.b64decode(packed(values)["f32"]), "<f4")
    assert np.array_equal(read, values.astype(np.float32).ravel(), equal_nan=True)
