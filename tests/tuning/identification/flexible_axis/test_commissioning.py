import numpy as np
import pytest

from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.plants.flexible_axis.linear_motor import thesis_motor
from tuning.identification.flexible_axis.commissioning import (
    ACCELERATION,
    DRIVE,
    STEP,
    Commissioning,
    Passes,
)
from tuning.identification.flexible_axis.instruments import Instruments

PERFECT = Instruments(resolution=1e-9, encoder_noise=0.0, current_noise=0.0)


def test_passes_there_and_back():
    law = Passes(0.3, (0.1, 0.2), pause=0.5)
    time = np.arange(0, law.duration, 1e-3)
    place = law(time)
    speed = np.diff(place) / 1e-3
    assert law.duration == pytest.approx(
        2 * (3 + 0.1 / ACCELERATION + 0.5) + 2 * (1.5 + 0.2 / ACCELERATION + 0.5), abs=1e-3
    )
    assert place.min() == 0.0 and place.max() == 0.3 and place[-1] == 0.0
    assert speed.max() == pytest.approx(0.2) and speed.min() == pytest.approx(-0.2)
    assert np.abs(np.diff(speed)).max() <= ACCELERATION * 1e-3 * (1 + 1e-6)


def test_the_electrical_test_obeys_the_winding():
    """R, L and k_e of the plant explain the recorded voltage.

    (3.4) is integrated over rows by the trapezoid rule.
    """
    record = Commissioning(thesis_axis(), thesis_motor(), PERFECT).electrical()
    i, v = record.current, np.diff(record.motor) / DRIVE
    voltage = 12.51 * (i[1:] + i[:-1]) / 2 + 10.7e-3 * np.diff(i) / DRIVE + 52.89 * v
    calm = np.abs(np.diff(i)) < 1e-3 * STEP  # where the trapezoid rule is good
    assert calm.mean() > 0.8 and np.abs(record.voltage[:-1] - voltage)[calm].max() < 0.02
    assert np.abs(record.current_d).max() < 0.01 * STEP and np.abs(v).max() > 0.1


def test_noise_is_as_stated_and_repeatable():
    law = Passes(0.01, (0.05,), pause=0.1)
    noisy = Instruments(resolution=1e-6, encoder_noise=0.0, current_noise=0.5)
    first, again, other = (
        Commissioning(thesis_axis(), thesis_motor(), noisy, seed=seed).motion("short", law)
        for seed in (3, 3, 4)
    )
    exact = Commissioning(thesis_axis(), thesis_motor(), noisy._replace(current_noise=0.0)).motion(
        "short", law
    )
    np.testing.assert_array_equal(first.current, again.current)
    assert np.any(first.current != other.current)
    assert np.std(first.current - exact.current) == pytest.approx(0.5, rel=0.1)
    np.testing.assert_array_equal(
        first.tool, exact.tool
    )  # the currents' noise is the recorder's alone
