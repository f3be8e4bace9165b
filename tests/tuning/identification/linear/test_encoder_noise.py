from dataclasses import replace

import numpy as np
import pytest

from jcontour.linear.continuous_axes import force_axis, position_axis
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.encoder_noise import encoder_noise
from tuning.identification.linear.output_error import AxisRecord, simulated
from tuning.identification.linear.recording import RecordedAxis, recorded

DT, ROWS, COUNT = 1e-3, 30_000, 1e-6
FORCE = force_axis(40.0, 80.0, 300.0)


def record(axis, takes, loop, noise, disturbance):
    """Slow arcs under a cascade; counts of 1 um."""
    random = np.random.default_rng(4)
    reference = 0.01 * np.sin(2 * np.pi * 0.7 * DT * np.arange(ROWS))
    one = RecordedAxis(axis, takes, COUNT, noise, disturbance, loop)
    return AxisRecord(DT, *recorded(one, reference, DT, random))


def force_model():
    """K / (M s^2 + F s) under a held command, in closed form."""
    T, K = 80 / 300, 40 / 300
    p = np.exp(-DT / T)
    b = K * T * np.array([DT / T - 1 + p, 1 - p - DT / T * p])
    return AxisModel(np.array([-p]), b, 1, 0, DT)


@pytest.mark.parametrize("disturbance", [0.0, 2e-3])
@pytest.mark.parametrize("noise", [0.5e-6, 3e-6])
def test_noise_is_told_from_what_comes_to_the_command(noise, disturbance):
    one = record(FORCE, "force", (10.0, 100.0), noise, disturbance)
    found = encoder_noise(simulated(one, force_model()), COUNT)
    assert found == pytest.approx(noise, rel=0.04)


@pytest.mark.parametrize("disturbance", [0.0, 2e-3])
def test_rounding_alone_is_no_noise(disturbance):
    one = record(FORCE, "force", (10.0, 100.0), 0.0, disturbance)
    assert encoder_noise(simulated(one, force_model()), COUNT) == 0.0


def test_noise_behind_a_larger_one_of_the_command_is_not_told():
    """A quick position drive: at half the sampling rate the command brings 14 um."""
    axis = position_axis(1.0, 0.001)
    p = np.exp(-1.0)
    model = AxisModel(np.array([-p]), np.array([1 - p]), 0, 0, DT)
    one = record(axis, "position", (1.0,), 0.5e-6, 2e-3)
    assert encoder_noise(simulated(one, model), COUNT) == 0.0


def test_a_record_without_any_error_has_no_noise():
    one = record(FORCE, "force", (10.0, 100.0), 0.0, 0.0)
    exact = simulated(one, force_model())
    assert encoder_noise(replace(exact, residual=0 * exact.residual), COUNT) == 0.0
