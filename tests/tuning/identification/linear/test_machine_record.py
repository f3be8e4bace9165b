"""Records whose encoder is read more slowly than the log is written."""

import numpy as np
import pytest
from scipy.signal import lfilter

from jcontour.linear.continuous_axes import speed_axis
from tests.tuning.identification.linear.recorded_axes import RecordedAxis, recorded
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord, updates

SLOW, TIMES = 5e-3, 5  # [s] between readings; rows of the log that have each


@pytest.fixture(scope="module")
def slow():
    """What a drive of 200 Hz says of its axis."""
    drive = RecordedAxis(speed_axis(0.02, 0.05, SLOW), "speed", 1e-6, 0.5e-6, 1e-3, (500.0,))
    reference = np.repeat(np.random.default_rng(0).uniform(-0.01, 0.01, 75), 40)
    u, y = recorded(drive, reference, SLOW, np.random.default_rng(1))
    return MachineRecord(SLOW, ("X",), u[:, None], y[:, None])


def logged(record, rows):
    """The record as a log of five times its rate has it."""
    return MachineRecord(SLOW / TIMES, ("X",), record.command[rows], record.position[rows])


def test_a_position_that_is_held_gives_the_model_of_its_own_rate(slow):
    held = logged(slow, np.repeat(np.arange(3000), TIMES))
    own, said = held.at_own_rate()
    assert own.dt == SLOW and len(own.position) == 2999
    assert own.position == pytest.approx(slow.position[:-1], abs=0)
    assert own.command == pytest.approx(slow.command[:-1], rel=1e-12)
    assert "changes every 5 rows of the log" in said[0] and "200 Hz" in said[0]
    found = identify_machine(held, 1, 4)
    truth = identify_machine(
        MachineRecord(SLOW, ("X",), *(signal[:-1] for signal in (slow.command, slow.position))),
        1,
        4,
    )
    assert found.notes[0] == said[0] and found.record.dt == SLOW
    for one in ("denominator", "numerator"):
        expected = getattr(truth.axes[0].fit.model, one)
        assert getattr(found.axes[0].fit.model, one) == pytest.approx(expected, rel=1e-6)
    assert found.axes[0].fit.model.delay == truth.axes[0].fit.model.delay
    assert found.axes[0].explained == pytest.approx(truth.axes[0].explained, abs=1e-6)


def test_clocks_that_drift_apart(slow):
    """Every two seconds the log has a position once more."""
    times = np.where(np.arange(3000) % 400 == 399, TIMES + 1, TIMES)
    own, _ = logged(slow, np.repeat(np.arange(3000), times)).at_own_rate()
    assert own.position == pytest.approx(slow.position[:-1], abs=0)
    assert own.dt == pytest.approx(SLOW, rel=1e-3)


def test_the_command_between_two_readings_counts_by_its_mean():
    """Closed form: a pure integrator whose command changes every row."""
    command = np.random.default_rng(0).standard_normal(15_000)
    position = np.cumsum(np.append(0.0, command[:-1]))[np.arange(15_000) // TIMES * TIMES]
    own, _ = MachineRecord(1e-3, ("X",), command[:, None], position[:, None]).at_own_rate()
    moved = np.diff(own.position[:, 0])
    assert moved == pytest.approx(TIMES * own.command[:-1, 0])


def test_coarse_counts_and_even_motions_are_no_slower_clock():
    time = 1e-3 * np.arange(20_000)
    even = np.floor(0.5 + 200.0 * time)  # a count every five rows
    moves = np.floor(0.5 + 40.0 * np.sin(3.0 * time) + 15.0 * np.sin(0.7 * time))
    noise = np.round(2.0 * np.random.default_rng(0).standard_normal(20_000))
    smooth = lfilter([0.02], [1.0, -0.98], np.repeat(noise[:200], 100))
    for position in (even, moves, noise, smooth, 1e-3 * moves + 1e-4 * noise):
        assert len(updates(position)) == len(position)
    assert len(updates(moves[np.arange(20_000) // 8 * 8])) == 20_000 / 8


def test_too_few_readings_are_told(slow):
    held = logged(slow, np.repeat(np.arange(400), TIMES))
    with pytest.raises(ValueError, match="read at 200 Hz.*needs at least 500, has 399"):
        held.at_own_rate()
