"""Intervals of a response that hold sharp modes, at frequencies close enough to see them."""

from dataclasses import replace

import numpy as np
import pytest

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.evidence import Response
from tuning.identification.linear.held_response import (
    LEAST_DAMPING,
    around_modes,
    held_response,
)

DT, HERTZ = 1e-3, 45.0


def ringing(damping, hertz=HERTZ):
    """A pair of poles of a frequency and a damping, with a gain of one at rest."""
    rate = 2 * np.pi * hertz * (-damping + 1j * np.sqrt(1 - damping**2))
    below = np.real(np.poly(np.exp(DT * np.array([rate, np.conj(rate)]))))
    return AxisModel(below[1:], np.array([below.sum()]), 0, 0, DT)


def height(damping):
    """Largest gain of the continuous oscillator."""
    return 1 / (2 * damping * np.sqrt(1 - damping**2))


@pytest.mark.parametrize("damping", [0.0, 1e-4, 2e-3])
def test_a_pair_without_damping_gets_the_least_of_machines(damping):
    found = ringing(damping).damped(LEAST_DAMPING)
    np.testing.assert_allclose(found.denominator, ringing(LEAST_DAMPING).denominator, rtol=1e-12)


def test_other_poles_stay():
    damped = ringing(0.02)
    assert damped.damped(LEAST_DAMPING) is damped
    real = replace(damped, denominator=np.array([-0.9, 0.0]))  # one of them at zero
    assert real.damped(LEAST_DAMPING) is real
    both = np.convolve(np.append(1.0, ringing(0.0).denominator), [1.0, -0.9])
    found = replace(damped, denominator=both[1:]).damped(LEAST_DAMPING)
    assert min(abs(found.poles - 0.9)) < 1e-12


@pytest.mark.parametrize("damping", [0.005, 0.01, 0.04])
def test_the_peak_of_a_sharp_mode_is_among_the_frequencies(damping):
    found = ringing(damping)
    places = around_modes(found)
    assert len(places) == 9
    peak = np.abs(found.response(2 * np.pi * places)).max() / np.abs(found.response(np.zeros(1)))
    assert peak.item() == pytest.approx(height(damping), rel=0.02)


def test_a_mode_that_is_damped_well_needs_no_more_frequencies():
    assert around_modes(ringing(0.1)).size == 0
    assert around_modes(replace(ringing(0.1), denominator=np.array([-0.9]))).size == 0


def test_the_interval_holds_a_mode_of_another_model_up_to_its_peak():
    """A flat response of one, beside a model that may ring without damping at 45 Hz."""
    places = np.union1d(np.geomspace(1.0, 400.0, 50), around_modes(ringing(LEAST_DAMPING)))
    flat = Response(places, np.ones(places.size, complex), np.full(places.size, 0.01))
    held = held_response(flat, [ringing(0.0)], [])
    assert held.half_width.max() == pytest.approx(height(LEAST_DAMPING), rel=0.03)
    true = np.abs(ringing(0.008).response(2 * np.pi * places) - 1)
    assert (true <= held.half_width + 1e-12).all()
