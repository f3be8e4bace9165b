"""A mass with friction and a drive that follows, each from a record whose truth is known."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import lfilter

from jcontour.plants import emps
from tests.app.machines.test_emps_record import emps_record
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.output_error import AxisRecord
from tuning.identification.linear.rigid_axis import moves_of, reversal_error, simplest
from tuning.identification.linear.validation import resolution_of, speed_signs

RECORDS = Path(__file__).parents[5] / "shared" / "data" / "records"
DT = emps.SAMPLE_PERIOD


def moves(rows):
    """Moves to and fro with smooth ends."""
    time = DT * np.arange(rows)
    knots = np.random.default_rng(0).uniform(0.0, 0.24, 2 + int(time[-1]))
    part = np.minimum(time % 1.0 / 0.9, 1.0)
    smooth = part**3 * (10 - 15 * part + 6 * part**2)
    whole = time.astype(int)
    return knots[whole] + (knots[whole + 1] - knots[whole]) * smooth


def gain(found):
    """Speed at rest per unit of command."""
    model = found.fit.model
    return model.numerator.sum() / (1 + model.denominator.sum()) / model.dt


def found_of(record, resolution, most_delay):
    """The simple model of a record that has one."""
    found = simplest(record, resolution, most_delay)
    assert found is not None
    return found


def test_the_mass_and_the_friction_of_a_simulated_drive():
    voltage, position = emps_record(moves(14_000), 1)
    found = found_of(AxisRecord(DT, voltage, position), emps.RESOLUTION, 3)
    assert gain(found) == pytest.approx(emps.DRIVE_GAIN / emps.VISCOUS, rel=0.02)
    pole = np.exp(-DT * emps.VISCOUS / emps.MASS)
    assert found.fit.model.denominator[0] == pytest.approx(-pole, abs=1e-4)
    assert found.estimate["friction"] == pytest.approx(emps.COULOMB / emps.DRIVE_GAIN, rel=0.01)
    assert found.estimate["offset"] == pytest.approx(-emps.OFFSET / emps.DRIVE_GAIN, rel=0.02)
    assert found.explained > 0.999 and found.fit.model.delay <= 1


def test_the_mass_of_a_slow_joint_whose_log_is_slow_too():
    """u = m a + c v + f sign(v) + o of a sine of 0.1 Hz and 3 rad that is logged at 100 Hz."""
    dt, w, (m, c, f, o) = 0.01, 2 * np.pi * 0.1, (0.53, 2.2, 1.36, 0.02)
    time = dt * np.arange(6000)
    speed, bend = 1.5 * w * np.cos(w * time), -1.5 * w**2 * np.sin(w * time)
    position = 1e-5 * np.round((1.5 * np.sin(w * time) - 1.0) / 1e-5)
    found = found_of(
        AxisRecord(dt, m * bend + c * speed + f * np.sign(speed) + o, position), 1e-5, 3
    )
    assert gain(found) == pytest.approx(1 / c, rel=0.02)
    assert -dt / np.log(found.fit.model.poles[0].real) == pytest.approx(m / c, rel=0.04)
    assert found.estimate["friction"] == pytest.approx(f, rel=0.02)
    assert found.estimate["offset"] == pytest.approx(-o, abs=0.01)


def test_a_drive_that_follows_late_by_parts_of_a_sample():
    command = np.cumsum(np.random.default_rng(0).standard_normal(3000))
    late = 2e-3 * (0.3 * np.roll(command, 3) + 0.7 * np.roll(command, 4))
    late[:4] = 2e-3 * command[0]
    found = found_of(AxisRecord(DT, command, late), 1e-6, 5)
    assert found.fit.model.delay == 2 and found.fit.drag[0] < 1e-5 * np.ptp(command)
    assert found.fit.model.numerator == pytest.approx([6e-4, 1.4e-3], rel=1e-2)
    assert found.explained > 0.9999


def test_a_drive_that_follows_behind_a_lag_and_parts_of_a_sample():
    """18 ms and 1.5 ms: b_1 = 1 - exp(-0.5 / 18), b_2 = exp(-0.5 / 18) - exp(-1 / 18)."""
    command = moves(8000)
    parts = 1 - np.exp(-DT / 2 / 0.018), np.exp(-DT / 2 / 0.018) - np.exp(-DT / 0.018)
    pole = float(np.exp(-DT / 0.018))
    position = command[0] + lfilter([0, 0, *parts], [1.0, -pole], command - command[0])
    position = 1e-6 * np.round(position / 1e-6)
    found = found_of(AxisRecord(DT, command, position), 1e-6, 5)
    model = found.fit.model
    assert model.poles.real == pytest.approx([pole], abs=1e-4) and model.integrators == 0
    assert model.delay == 1 and model.numerator == pytest.approx(parts, rel=0.1)
    hertz = np.array([0.5, 5.0, 20.0])
    true = AxisModel(np.array([-pole]), np.array(parts), 0, 1, DT).response(2 * np.pi * hertz)
    assert np.abs(model.response(2 * np.pi * hertz) / true - 1).max() < 5e-3
    assert found.explained > 0.9999


def servo(command, position_gain, velocity_gain, mass, friction):
    """Motion of a cascade under dry friction, by steps of a twentieth of a sample."""
    x, v, found, step = command[0], 0.0, [], DT / 20
    for wanted in command:
        found.append(x)
        for _ in range(20):
            force = velocity_gain * (position_gain * (wanted - x) - v)
            way = np.sign(v) or np.sign(force) * (abs(force) > friction)
            after = v + step * (force - friction * way) / mass if way else 0.0
            v = 0.0 if after * way < 0 else after
            x += step * v
    return np.array(found)


def test_the_reversal_error_of_a_drive_with_friction():
    """F / (k_v k_p) in closed form; the moves show the static gain of 1, not that of the model."""
    position_gain, velocity_gain, friction = 50.0, 2e4, 60.0
    command = moves(10_000)
    position = servo(command, position_gain, velocity_gain, 90.0, friction)
    record = AxisRecord(DT, command, position, (speed_signs(position, 1e-6),))
    pole = np.exp(-DT * position_gain)
    model = AxisModel(np.array([-pole]), np.array([1.003 * (1 - pole)]), 0, 0, DT)
    slow = moves_of(record, model, np.array([1e-3, 0.05]))
    assert np.abs(slow.value) == pytest.approx([1.0, 1.0], abs=3e-4)
    lag = 1 / position_gain + 0.5 * DT
    assert -np.angle(slow.value[1]) == pytest.approx(2 * np.pi * 0.05 * lag, rel=0.05)
    right = AxisModel(np.array([-pole]), np.array([1 - pole]), 0, 0, DT)
    expected = friction / (velocity_gain * position_gain)
    assert reversal_error(record, right) == pytest.approx([expected], rel=0.05)


@pytest.mark.skipif(not (RECORDS / "emps").exists(), reason="the public records are not here")
@pytest.mark.parametrize("name", ["DATA_EMPS", "DATA_EMPS_PULSES"])
def test_the_public_record_of_the_drive(name):
    """Janot, Gautier & Brunot, 2019; what least squares of the whole estimation record give."""
    data = loadmat(RECORDS / "emps" / f"{name}.mat")
    record = AxisRecord(DT, data["vir"].ravel(), data["qm"].ravel())
    found = found_of(record, resolution_of(record.position), 3)
    assert found.explained > 0.995
    low, high = found.estimate.interval("friction")
    assert low < 0.596 < high
    if name == "DATA_EMPS":
        assert gain(found) == pytest.approx(0.1778, rel=0.03)
        assert found.estimate["friction"] == pytest.approx(0.596, rel=0.03)
