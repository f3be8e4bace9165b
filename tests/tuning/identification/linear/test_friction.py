"""A drive of a speed with dry friction, K (u - F tanh(v / v_0)) = T v' + v, counted at 4 kHz."""

import numpy as np
import pytest

from tuning.identification.linear import evidence
from tuning.identification.linear.found import MachineRecord
from tuning.identification.linear.friction import soft_signs
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.output_error import AxisRecord

DT, ROWS, COUNT, LATE = 2.5e-4, 8000, 1.25e-6, 3
K, T, SOFT = 25e-3, 8e-3, 0.5e-3  # [m/s/V], [s], speed at which friction turns [m/s]


def record(friction, seed):
    """Under a position and a speed loop, asked for sines of up to 12 Hz; 10 mV on the command."""
    random, inner = np.random.default_rng(seed), 8
    time = DT * np.arange(ROWS)
    tones = ((0.7, 4e-3), (2.3, 3e-3), (5.1, 1.5e-3), (8.7, 8e-4), (12.0, 5e-4))
    asked = sum(a * np.sin(2 * np.pi * f * time + random.uniform(0, 6)) for f, a in tones)
    u, y = np.zeros(ROWS), np.zeros(ROWS)
    x = v = total = 0.0
    h = DT / inner
    for k in range(ROWS):
        y[k] = COUNT * np.floor(x / COUNT)
        error = 40 * (asked[k] - y[k]) - (y[k] - y[k - 1]) / DT if k else 0.0
        total += 2000 * error * DT
        u[k] = 25 * error + total
        acting = u[k - LATE] if k >= LATE else 0.0
        for _ in range(inner):  # linearly implicit: stable however fast friction turns
            turned = np.tanh(v / SOFT)
            slope = (1 + K * friction * (1 - turned**2) / SOFT) / T
            step = h * (K * (acting - friction * turned) - v) / T / (1 + h * slope)
            x, v = x + h * (v + step / 2), v + step
    return AxisRecord(DT, u + 0.01 * random.standard_normal(ROWS), y)


def held_response(frequency):
    """Of the axis without friction to a held command, exactly."""
    p, z = np.exp(-DT / T), np.exp(2j * np.pi * frequency * DT)
    above = K * T * ((DT / T - 1 + p) * z + 1 - p - DT / T * p)
    return above / ((z - 1) * (z - p)) * z**-LATE


@pytest.mark.slow
def test_response_and_delay_are_those_without_friction():
    """Between 0.7 and 20 Hz, with 2 % of the command taken by friction."""
    one = record(0.15, 0)
    both = MachineRecord(DT, ("X",), one.command[:, None], one.position[:, None])
    axis = identify_machine(both, 2, 5).axes[0]
    assert axis.friction is not None and axis.friction[0] == pytest.approx(0.15, rel=0.03)
    assert axis.fit.model.delay == LATE or LATE in axis.delays
    inside = (axis.response.frequency > 0.7) & (axis.response.frequency < 20)
    frequency = axis.response.frequency[inside]
    off = np.abs(axis.fit.model.response(2 * np.pi * frequency) / held_response(frequency) - 1)
    assert off.max() < 0.01


def test_soft_signs_are_tanh_of_the_motion_around_a_sample():
    y = np.concatenate([np.zeros(20), 1e-3 * np.arange(1, 41), np.full(20, 0.04)])
    signs = soft_signs(y, 4e-3, 2)
    assert signs[40] == pytest.approx(-np.tanh(3 / 4))  # three samples of 1 mm over 4 mm
    assert not signs[:15].any() and not signs[65:].any()
    assert np.array_equal(soft_signs(-y, 4e-3, 2), -signs)
    assert evidence.HALVES[0] == 1
    assert soft_signs(y, 4e-3, 1)[30] == pytest.approx(-np.tanh(1 / 4))
