from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from jcontour.app.files.run_folder import json_text
from jcontour.app.flags.machines import Machine
from jcontour.app.machines.built import built_machine
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.machine_behaviour import (
    axis_behaviours,
    questions,
    response,
    steady_response,
)
from jcontour.linear.continuous_axes import (
    force_axis,
    position_axis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay

MILL = Machine(gain=(2.0,), time_constant_ms=(20.0,), delay_ms=(3.0,), max_control=(100.0,))


def loaded(flags):
    return machine_from(json_text(built_machine(flags).fields).encode())


def test_a_speed_drive_shows_its_numbers():
    x, y = axis_behaviours(loaded(replace(MILL, resonance_hz=(0.0, 60.0))))
    assert x.kind == y.kind == "speed" and x.gain == pytest.approx(2e-3, rel=1e-6)
    assert x.rise == pytest.approx(0.02, abs=1.1e-3)
    assert x.delay == y.delay == 3
    assert x.acceleration == pytest.approx(2e-3 / 0.02, rel=0.05)
    assert np.isnan(x.resonance) and y.resonance == pytest.approx(60.0, rel=0.01)


def test_other_drives_settle_elsewhere():
    flags = replace(MILL, takes="position", gain=(2.0,))
    assert axis_behaviours(loaded(flags))[0].kind == "position"
    free = Machine(takes="force", gain=(10.0,), mass_kg=(5.0,))
    one = axis_behaviours(loaded(free))[0]
    assert one.kind == "acceleration" and one.gain == pytest.approx(2.0, rel=1e-6)


def test_a_slide_that_settles_slowly_is_told_where_it_settles():
    """Force over friction, and 63 % of it after M / F: longer than the shortest step response."""
    for mass, constant in ((1.0, 0.5), (20.0, 10.0)):
        flags = Machine(takes="force", gain=(3.0,), mass_kg=(mass,), viscous=(2.0,))
        one = axis_behaviours(loaded(replace(flags, delay_ms=(2.0,))))[0]
        assert one.kind == "speed" and one.gain == pytest.approx(1.5, rel=1e-9)
        assert one.rise == pytest.approx(constant, abs=1.1e-3) and one.delay == 2


def test_a_response_at_low_frequency_is_an_integrator():
    machine = loaded(replace(MILL, delay_ms=(0.0,)))
    value = response(machine.model, 1, np.array([0.01]))
    assert abs(value[0]) == pytest.approx(2e-3 / (2 * np.pi * 0.01), rel=1e-3)


def test_wrong_units_are_questioned():
    sound = loaded(MILL)
    assert questions(sound, axis_behaviours(sound)) == []
    wrong = loaded(replace(MILL, length_unit="m", time_constant_ms=(15.0,)))
    lines = questions(wrong, axis_behaviours(wrong))  # 200 m/s in 15 ms
    assert "g; is length_unit right?" in lines[0] and "12000000 mm/min" in lines[1]
    slow = loaded(replace(MILL, max_speed=(500.0,)))
    assert (
        "12000 mm/min, less than its limit of 30000 mm/min"
        in questions(slow, axis_behaviours(slow))[0]
    )
    just = loaded(replace(MILL, max_speed=(200.0,)))  # the same number, computed two ways
    assert questions(just, axis_behaviours(just)) == []
    for stated, message in (
        (2.5, "0.0025 m/s^2; is length_unit"),
        (2.5e6, "2.5e+03 m/s^2; is len"),
    ):
        metres = loaded(replace(MILL, max_acceleration=(stated,)))  # [mm/s^2]
        assert [message in line for line in questions(metres, axis_behaviours(metres))] == [
            True
        ] * 2
    unknown = loaded(replace(MILL, max_control=()))
    assert "limits.control is not given" in questions(unknown, axis_behaviours(unknown))[0]


def test_a_count_as_of_no_encoder_is_questioned():
    """Micrometres read as millimetres: 0.1 um of one axis become 100."""
    coarse = loaded(replace(MILL, encoder_um=(1.0, 100.0)))
    (line,) = questions(coarse, axis_behaviours(coarse))
    assert line.startswith("Y: counts of 100 um are coarser than those of a machine; are lengths")
    usual = loaded(replace(MILL, encoder_um=(40.0,)))
    assert questions(usual, axis_behaviours(usual)) == []


def test_a_position_drive_is_not_asked_about_a_step_over_its_whole_travel():
    machine = loaded(replace(MILL, takes="position", gain=(1.0,), time_constant_ms=(5.0,)))
    one = axis_behaviours(machine)[0]
    assert 100.0 * one.acceleration > 1e4  # [m/s^2], which nobody asks of it
    assert questions(machine, axis_behaviours(machine)) == []


@pytest.mark.parametrize("milliseconds", [2000.0, 20.5, 0.0099])
def test_an_unusual_sample_period_is_questioned(milliseconds):
    machine = loaded(replace(MILL, period_ms=milliseconds, delay_ms=(0.0,)))
    (line,) = questions(machine, axis_behaviours(machine))
    assert line.startswith(f"a sample period of {milliseconds:g} ms is unusual")


@pytest.mark.parametrize("milliseconds", [20.0, 1.0, 0.01])
def test_a_usual_sample_period_is_not(milliseconds):
    machine = loaded(replace(MILL, period_ms=milliseconds, delay_ms=(0.0,)))
    assert questions(machine, axis_behaviours(machine)) == []


@pytest.mark.parametrize("mass", [2.0, 180.0, 2e3])  # the last needs half an hour to settle
def test_a_slide_with_viscous_friction_goes_at_force_over_friction(mass):
    axis = force_axis(gain=31.0, mass=mass, viscous=5.0, delay=0.6e-3)
    other = speed_axis(2.0, 0.01)
    model = with_input_delay(sampled_machine([axis, other], 1e-3)[0], 3)
    steady = steady_response(model, 0)
    assert steady.kind == "speed" and steady.gain == pytest.approx(31.0 / 5.0, rel=1e-8)
    assert steady.slowest == pytest.approx(mass / 5.0 / 1e-3, rel=1e-6)
    assert steady_response(model, 1).gain == pytest.approx(2.0, rel=1e-10)


def test_drives_settle_as_their_transfer_function_says():
    soft = with_resonance(force_axis(10.0, 5.0), 2 * np.pi * 40, 0.02)
    place = with_resonance(position_axis(0.7, 0.004), 2 * np.pi * 60, 0.05)
    model, _ = sampled_machine([soft, place, speed_axis(3.0, 0.0, 1e-3)], 1e-3)
    steady = [steady_response(model, axis) for axis in range(3)]
    assert [one.kind for one in steady] == ["acceleration", "position", "speed"]
    assert [one.gain for one in steady] == pytest.approx([2.0, 0.7, 3.0], rel=1e-6)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_states_that_are_mixed_settle_where_a_long_run_ends(seed):
    """States of both axes in other coordinates, where no zero of A tells the axes apart."""
    random = np.random.default_rng(seed)
    axes = [with_resonance(speed_axis(0.5, 0.03), 200.0, 0.1), position_axis(2.0, 0.01)]
    plain, _ = sampled_machine(axes, 1e-3)
    turn = random.normal(size=(plain.states, plain.states))
    A, B, C = (np.asarray(one) for one in (plain.A, plain.B, plain.C))
    M, columns, rows = turn @ A @ np.linalg.inv(turn), turn @ B, C @ np.linalg.inv(turn)
    for axis, kind in enumerate(("speed", "position")):
        x, y = np.zeros(len(M)), []
        for _ in range(3000):
            x = M @ x + columns[:, axis]
            y.append(rows[axis] @ x)
        ends = {"speed": (y[-1] - y[-2]) / 1e-3, "position": y[-1]}
        steady = steady_response(LinearPlant(M, columns, rows, 1e-3), axis)
        assert steady.kind == kind and steady.gain == pytest.approx(ends[kind], rel=1e-6)


def test_nothing_lasts_of_an_axis_that_runs_away():
    A = block_diag(1.001, 1.0)
    model = LinearPlant(A, np.eye(2), np.eye(2), 1e-3)
    away, sound = steady_response(model, 0), steady_response(model, 1)
    assert away.kind == "nothing" and np.isnan(away.gain)
    assert sound.kind == "speed" and sound.gain == pytest.approx(1e3)
