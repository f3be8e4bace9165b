import numpy as np
import pytest

from jcontour.linear import continuous_axes
from jcontour.linear.continuous_axes import position_axis, speed_axis
from tuning.identification.linear.noise_model import whitening
from tuning.identification.linear.order_search import NOISE_TERMS
from tuning.identification.linear.output_error import (
    AxisRecord,
    Structure,
    fitted,
    simulated,
    structure_of,
)
from tuning.identification.linear.recording import RecordedAxis, recorded
from tuning.identification.linear.resonance import DAMPINGS, FREQUENCIES, _pairs, with_resonance

DT, HERTZ, DAMPING = 1e-3, 60.0, 0.1


def logged(axis, takes, gain, rows):
    """A record in closed loop of a motion to and fro, with a corner every fifth of a second."""
    random = np.random.default_rng(2)
    time = DT * np.arange(rows)
    reference = 0.05 * DT * np.cumsum(np.sign(np.sin(2 * np.pi * 2.5 * time)))
    resonant = continuous_axes.with_resonance(axis, 2 * np.pi * HERTZ, DAMPING)
    one = RecordedAxis(resonant, takes, 0.5e-6, 0.2e-6, 1e-3, (gain,))
    return AxisRecord(DT, *recorded(one, reference, DT, random))


def test_the_grid_is_of_frequencies_and_dampings():
    """Poles exp(-zeta w +- j w sqrt(1 - zeta^2))."""
    logs = [np.log(np.roots(pair)[:1]) for pair in _pairs()]
    found = np.array([[np.abs(one[0]), -one[0].real / np.abs(one[0])] for one in logs])
    np.testing.assert_allclose(found[:, 0], np.repeat(FREQUENCIES, len(DAMPINGS)), rtol=1e-9)
    np.testing.assert_allclose(found[:, 1], np.tile(DAMPINGS, len(FREQUENCIES)), rtol=1e-9)


@pytest.mark.parametrize("takes", ["speed", "position"])
def test_the_pair_of_poles_is_laid_where_the_resonance_is(takes):
    """Its frequency to a step of the grid, and a numerator that explains more than without it."""
    i, make = (1, speed_axis) if takes == "speed" else (0, position_axis)
    record = logged(make(0.8, 0.015, DT), takes, 10.0 if takes == "speed" else 1.2, 5000)
    base = fitted(record, Structure(1, 1 + i, i, 4))
    base = fitted(record, structure_of(base.model), whitening(base.residual, NOISE_TERMS))
    found = with_resonance(record, base)
    assert structure_of(found) == Structure(3, 3 + i, i, found.delay) and found.delay <= 4
    (pole,) = (one for one in found.poles if one.imag > 0)
    laid = abs(np.log(pole))
    assert 1 / (FREQUENCIES[1] / FREQUENCIES[0]) < laid / (2 * np.pi * HERTZ * DT) < 1.33
    with_pair = simulated(record, found, base.filter)
    assert with_pair.loss < base.loss
