"""Preview filters against scipy and against steady motion in closed form."""

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.signal import lfilter

from jcontour.controllers.feedforward.zpetc import PreviewFilter, causal
from jcontour.geometry.contours import line
from jcontour.motion.references import along

TOP, BELOW = np.array([0.5, -0.2, 0.1]), np.array([2.0, -1.0, 0.3, 0.1])


def test_causal_is_lfilter():
    samples = np.random.default_rng(0).standard_normal((40, 2))
    rows = (np.stack([TOP, -TOP]), np.stack([BELOW, BELOW]))
    found = jax.jit(causal)(rows[0], rows[1], samples)
    wanted = np.stack(
        [lfilter(TOP, BELOW, samples[:, 0]), lfilter(-TOP, BELOW, samples[:, 1])], axis=1
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-14)


def test_it_has_been_running_before_the_first_sample():
    """The same as a filter that starts far back on the steady motion."""
    random = np.random.default_rng(1)
    start, increment = np.array([0.3, -1.0]), np.array([0.01, 0.02])
    count = np.arange(-400, 30)[:, None]
    samples = start + increment * count
    samples[401:] += random.standard_normal((29, 2))
    wanted = lfilter(TOP, BELOW, samples, axis=0)[400 + 3 :]
    filter = PreviewFilter(TOP, BELOW, preview=3)
    found = eqx.filter_jit(filter.filtered)(samples[400:], increment)
    # the long filter began with a jump 400 samples ago
    np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10)


def test_an_advance_is_the_reference_ahead():
    reference = along(line([0.0], [1.0]), 1e-3 * np.arange(9), 1e-3, preview=4, at_rest=False)
    found = eqx.filter_jit(PreviewFilter([1.0], [1.0], preview=2).of)(reference)
    np.testing.assert_allclose(found, np.asarray(reference.position)[2:11], atol=1e-15)


def test_bad_input():
    with pytest.raises(ValueError, match="not stable"):
        PreviewFilter([1.0], [1.0, -1.0], 0)
    with pytest.raises(ValueError, match="cannot be negative"):
        PreviewFilter([1.0], [1.0], -1)
    with pytest.raises(ValueError, match="finite"):
        PreviewFilter([np.nan], [1.0], 0)
    reference = along(line([0.0], [1.0]), 1e-3 * np.arange(9), 1e-3, preview=1, at_rest=False)
    with pytest.raises(ValueError, match="looks 2 samples ahead"):
        PreviewFilter([1.0], [1.0], 2).of(reference)
