"""Causal inversion of a model."""

import numpy as np
import pytest

from jcontour.controllers.feedforward.zpetc import causal_filter
from jcontour.linear.transfer_functions import from_polynomials


def test_plant_and_filter_leave_the_zeros_that_are_not_cancelled():
    """The stable zero is cancelled, the one outside the unit circle leaves its steady gain."""
    stable, outside = np.array([1.0, -0.4]), np.array([1.0, 1.8])
    top = np.concatenate([[0.0, 0.0], 0.3 * np.convolve(stable, outside)])
    transfer = from_polynomials(top, np.convolve([1.0, -1.0], [1.0, -0.7]), dt=1e-3)
    ahead = causal_filter(transfer)
    assert ahead.preview == 2
    lam = np.exp(-1j * np.array([0.01, 0.4, 2.5]))
    value = [np.polynomial.polynomial.polyval(lam, np.asarray(row)) for row in ahead_rows(ahead)]
    found = transfer.response(lam) * value[0] / value[1] * lam**-2.0
    np.testing.assert_allclose(found, (1 + 1.8 * lam) / 2.8, rtol=1e-10)


def ahead_rows(ahead):
    return ahead.numerator, ahead.denominator


def test_a_zero_at_one_is_refused():
    with pytest.raises(ValueError, match="zero at z = 1"):
        causal_filter(from_polynomials([0.0, 1.0, -1.0], [1.0, -0.5], dt=1e-3))
