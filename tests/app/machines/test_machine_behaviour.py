from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.files.run_folder import json_text
from jcontour.app.flags.machines import Machine
from jcontour.app.machines.built import built_machine
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.machine_behaviour import axis_behaviours, questions, response

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
    found = response(machine.model, 1, np.array([0.01]))
    assert abs(found[0]) == pytest.approx(2e-3 / (2 * np.pi * 0.01), rel=1e-3)


def test_wrong_units_are_questioned():
    sound = loaded(MILL)
    assert questions(sound, axis_behaviours(sound)) == []
    wrong = loaded(replace(MILL, length_unit="m", time_constant_ms=(15.0,)))
    lines = questions(wrong, axis_behaviours(wrong))  # 200 m/s in 15 ms
    assert "g; is length_unit right?" in lines[0] and "200 m/s" in lines[1]
    slow = loaded(replace(MILL, max_speed=(500.0,)))
    assert "200 mm/s, less than its limit of 500 mm/s" in questions(slow, axis_behaviours(slow))[0]
    just = loaded(replace(MILL, max_speed=(200.0,)))  # the same number, computed two ways
    assert questions(just, axis_behaviours(just)) == []
    for stated, told in ((2.5, "0.0025 m/s^2; is length_unit"), (2.5e6, "2.5e+03 m/s^2; is len")):
        metres = loaded(replace(MILL, max_acceleration=(stated,)))  # [mm/s^2]
        assert [told in line for line in questions(metres, axis_behaviours(metres))] == [True] * 2
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
