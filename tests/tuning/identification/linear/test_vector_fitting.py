"""Models of a frequency response that is known in closed form."""

import numpy as np
import pytest

from tuning.identification.linear.validation import Response
from tuning.identification.linear.vector_fitting import fitted_to


def test_a_gain_with_a_delay_is_found_as_one():
    """0.5 z^-3, by lines that are known to a tenth of a percent."""
    hertz = np.linspace(1.0, 200.0, 60)
    lines = Response(hertz, 0.5 * np.exp(-2j * np.pi * hertz * 3e-3), np.full(60, 1e-3))
    model = fitted_to(lines, 1e-3, 3, 6)
    assert (model.integrators, model.delay, len(model.denominator)) == (0, 2, 0)
    assert model.numerator == pytest.approx([0.5])
