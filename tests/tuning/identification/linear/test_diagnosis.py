from dataclasses import replace

import numpy as np
import pytest

from tests.app.small_runs import partly
from tuning.identification.linear.diagnosis import friction_hides, limits_of, notes, unusable
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord
from tuning.identification.linear.output_error import AxisFit
from tuning.identification.linear.rigid_axis import Simple


def test_where_dry_friction_acts_moves_are_advised_beside_the_sines(found):
    one = replace(found.axes[0], response=replace(found.axes[0].response, half_width=np.ones(120)))
    for friction, advised in ((None, False), ((0.1, 1e-3), True)):
        told = notes(replace(one, friction=friction))
        assert any("--excite" in note for note in told)
        assert any("its sines and then its moves" in note for note in told) is advised


def test_the_reversal_error_of_a_drive_that_takes_positions_is_said(found):
    """A friction of 10 um of the command, where a unit of it moves the axis by 0.5 m."""
    one = found.axes[0]
    model = replace(
        one.fit.model, integrators=0, denominator=np.zeros(0), numerator=np.full(1, 0.5)
    )
    drive = replace(one, fit=replace(one.fit, model=model), friction=(10e-6, 1e-6))
    (said,) = (note for note in notes(drive) if "turns about late" in note)
    assert "late by 10 um (+- 2)" in said and "backlash" in said
    assert not any("turns about" in note for note in notes(replace(one, friction=(0.1, 1e-3))))


@pytest.mark.parametrize(
    ("explained", "dispersion", "stands", "friction", "words"),
    [
        (0.84, 1.0, 0.3, False, "the axis stands still for 30 % of the record"),
        (0.84, 9.0, 0.0, True, "noise is not the reason"),
        (0.84, 1.0, 0.3, True, None),  # friction is known
        (0.84, 1.0, 0.05, False, None),  # noise may be why
        (0.95, 9.0, 0.3, False, None),
    ],
)
def test_little_is_explained_and_the_axis_rests_or_noise_is_not_why(
    explained, dispersion, stands, friction, words
):
    told = unusable(explained, dispersion, stands, friction)
    if words is None:
        assert told == ""
        return
    for one in (words, "explains 84 %", "dry (Coulomb) friction", "clip", "--most-order 2"):
        assert one in told


DT = 0.01
TIME = DT * np.arange(3000)
SWEEP = 0.005 * np.sin(2 * np.pi * (0.5 + 0.07 * TIME) * TIME)


def test_a_drive_that_limits_its_speed_is_told():
    place, places = 0.0, []
    for wanted in SWEEP:
        place += float(np.clip(wanted - place, -0.1 * DT, 0.1 * DT))  # [m/s]
        places.append(place)
    said = limits_of(1e3 * SWEEP, np.array(places), DT)
    assert "no faster than 6000 mm/min" in said
    assert limits_of(SWEEP, np.append([0.0, 0.0], SWEEP[:-2]), DT) == ""
    assert limits_of(SWEEP, np.cumsum(np.roll(SWEEP, 700)), DT) == ""
    slow = np.sin(2 * np.pi * 0.3 * TIME)  # beside a noisy command that is no position
    noisy = 1e3 * slow + 1.1e3 * np.random.default_rng(0).standard_normal(3000)
    assert "no faster than" not in limits_of(noisy, slow, DT)


def test_a_command_that_is_cut_before_it_acts_is_told():
    time = 1e-3 * np.arange(3000)
    command = np.sin(2 * np.pi * 1.3 * time) + 0.5 * np.sign(np.sin(2 * np.pi * 0.7 * time))
    speed, place, cut, whole = 0.0, 0.0, [], []
    for limit, places in ((0.6, cut), (9.0, whole)):
        speed = place = 0.0
        for u in np.clip(command, -limit, limit):
            places.append(place)
            speed += 0.05 * (0.02 * u - speed)
            place += 1e-3 * speed
    said = limits_of(command, np.round(np.array(cut), 6), 1e-3)
    assert "cut at about 0.6, and the log has it up to 1.5" in said
    assert limits_of(command, np.round(np.array(whole), 6), 1e-3) == ""


def test_a_command_near_half_the_rate_is_told():
    command = np.where(np.arange(2000) % 2, 1.0, -1.0)
    assert "aliasing" in limits_of(command, np.cumsum(command), 1e-3)


def test_swapped_axes_are_told():
    time = 1e-3 * np.arange(3000)
    command = np.stack([np.sin(5 * time), np.cos(8 * time)], axis=1)
    record = MachineRecord(1e-3, ("X", "Y"), command, command[:, ::-1] + 1e-6 * time[:, None])
    with pytest.raises(ValueError, match="X: its command moves Y, not X: change their columns"):
        identify_machine(record, 1, 1)


def test_an_axis_that_moves_at_the_beginning_alone_is_told():
    """A step whose answer is over after 2 of 30 s."""
    position = 1e-3 * (1 - np.exp(-TIME / 0.5))
    said = limits_of(np.full(3000, 1.0), position, DT)
    assert said.startswith("the axis moves for the first 0.9") and "machine --steps" in said
    assert not limits_of(SWEEP, np.append([0.0, 0.0], SWEEP[:-2]), DT)


def test_friction_that_takes_all_of_a_command_is_told():
    command = np.repeat([0.026, -0.031], 500)  # [Nm], of a small servo
    told = "dry friction takes nearly all"
    for friction, part, words in ((0.027, 0.7, told), (0.01, 0.7, ""), (0.027, 0.1, "")):
        fit = partly(AxisFit, drag=np.array([friction, 0.002]))
        simple = partly(Simple, fit=fit, explained=part)
        assert friction_hides(command, simple).startswith(words) and bool(
            friction_hides(command, simple)
        ) == bool(words)


def test_a_feedforward_that_the_log_does_not_have_is_told():
    """The log has what the feedback adds to a feedforward that is a tenth too large."""
    dt, time, noise = 1e-3, 1e-3 * np.arange(6000), np.random.default_rng(0).standard_normal(6000)
    wanted = 0.1 * np.sin(3 * time) + 0.02 * np.sin(11 * time)
    speeds = np.gradient(wanted, dt)
    forward = 1.1 * (10 * np.gradient(speeds, dt) + 50 * speeds)
    place = speed = before = 0.0
    command, position = np.zeros(6000), np.zeros(6000)
    for k in range(6000):
        position[k] = counted = 1e-7 * np.round(place / 1e-7)
        error = wanted[k] - counted
        command[k] = 2000 * error + 100 * (speeds[k] - (counted - before) / dt)
        before = counted
        speed += dt * (command[k] + forward[k] + 2 * noise[k] - 50 * speed) / 10
        place += dt * speed
    for u, words in (
        (command, "does a feedforward act"),
        (noise[::-1], "columns those of one axis"),
    ):
        with pytest.raises(ValueError, match=words):
            identify_machine(MachineRecord(dt, ("X",), u[:, None], position[:, None]), 2, 4)
