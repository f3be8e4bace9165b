from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from jcontour.linear.continuous_axes import force_axis, speed_axis, with_resonance
from tests.tuning.identification.linear.recorded_axes import RecordedAxis, recorded

DT = 1e-3


def test_a_proportional_loop_is_the_closed_transfer_function():
    """No counts to speak of, no noise: y = K G r / (1 + K G), by scipy."""
    K, T, loop = 0.5, 0.02, 12.0
    pair = tuple(cont2discrete(([K], [T, 1, 0]), DT))[:2]  # pyright: ignore
    num, den = (np.ravel(one) for one in pair)
    b = loop * np.concatenate([np.zeros(3 - num.size), num])
    r = np.sin(np.arange(2000) * 0.01)
    expected = lfilter(b, den + b, r)
    one = RecordedAxis(speed_axis(K, T), "speed", 1e-13, 0.0, 0.0, (loop,))
    u, y = recorded(one, r, DT, np.random.default_rng(0))
    assert np.allclose(y, expected, atol=1e-9)
    assert np.allclose(u, loop * (r - y))


def test_positions_are_counted_and_delayed():
    one = RecordedAxis(speed_axis(1.0, 0.0, 3 * DT), "speed", 1e-4, 0.0, 0.0, (5.0,))
    _, y = recorded(one, np.ones(50), DT, np.random.default_rng(0))
    assert np.allclose(np.round(y / 1e-4) * 1e-4, y)
    assert not y[:4].any() and y[4] > 0


def test_a_force_drive_follows():
    one = RecordedAxis(force_axis(35.0, 90.0, 200.0, DT), "force", 1e-7, 0.0, 0.0, (10.0, 150.0))
    _, y = recorded(one, np.full(4000, 0.01), DT, np.random.default_rng(0))
    assert abs(y[-1] - 0.01) < 1e-4


def test_dry_friction_holds_and_lags():
    """Of a ramp v t under u = k (r - y): none below u = F, then a lag of (v / K + F) / k."""
    gain, k, friction, v = 0.5, 20.0, 0.02, 0.01
    one = RecordedAxis(speed_axis(gain, 0.01), "speed", 1e-9, 0.0, 0.0, (k,), friction)
    r = v * DT * np.arange(4000)
    _, y = recorded(one, r, DT, np.random.default_rng(0))
    held = int(friction / k / v / DT)
    assert not y[:held].any() and y[held + 5] > 0
    assert r[-1] - y[-1] == pytest.approx((v / gain + friction) / k, rel=1e-3)


def test_friction_needs_a_command_that_acts_on_the_speed():
    one = RecordedAxis(force_axis(1.0, 1.0), "force", 1e-9, 0.0, 0.0, (1.0, 1.0), 0.1)
    apart = replace(one, axis=with_resonance(one.axis, 300.0, 0.1))
    with pytest.raises(ValueError, match="friction: the command needs to act on the speed"):
        recorded(apart, np.zeros(5), DT, np.random.default_rng(0))
