import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.identified import _thinned, axis_result, counts, largest, machine_fields
from jcontour.app.runs.tuning.results import _unmeasured
from jcontour.linear.continuous_axes import position_axis, speed_axis, with_resonance
from tests.tuning.identification.linear.recorded_axes import RecordedAxis, recorded
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord

DT = 1e-3
HERTZ, DAMPING = 45.0, 0.08


@pytest.fixture(scope="module")
def identified():
    rows, most_poles, most_delay = 8000, 3, 4
    soft = with_resonance(position_axis(1.0, 0.004, 2 * DT), 2 * np.pi * HERTZ, DAMPING)
    axes = (
        RecordedAxis(speed_axis(0.02, 0.01, 2 * DT), "speed", 1e-6, 0.5e-6, 1e-3, (500.0,)),
        RecordedAxis(soft, "position", 1e-6, 0.5e-6, 0.0, (1.0,)),
    )
    signals = []
    for k, one in enumerate(axes):
        random = np.random.default_rng(k)
        reference = np.repeat(random.uniform(-0.01, 0.01, rows // 50), 50)
        signals.append(recorded(one, reference, DT, random))
    u, y = (np.stack(part, axis=1) for part in zip(*signals, strict=True))
    return identify_machine(MachineRecord(DT, ("X", "Y"), u, y), most_poles, most_delay)


def test_numbers_of_an_axis_as_engineers_say_them(identified):
    x, y = (axis_result(one) for one in identified.axes)
    assert x.integrators == 1 and x.delay == 2
    assert x.gain == pytest.approx(0.02, rel=0.01)
    assert x.gain_interval[0] < 0.02 < x.gain_interval[1]
    assert x.time_constants == pytest.approx([0.01], rel=0.03) and not x.resonances
    assert y.integrators == 0 and y.gain == pytest.approx(1.0, rel=0.01)
    hertz, damping = y.resonances[0]
    assert hertz == pytest.approx(HERTZ, rel=0.02) and damping == pytest.approx(DAMPING, rel=0.2)
    assert x.explained > 0.99 and len(x.intervals) == len(x.denominator) + len(x.numerator)


def test_the_file_is_read_by_the_other_commands(identified):
    fields = machine_fields(identified, "mine", "V")
    machine = machine_from(json.dumps(fields).encode())
    assert machine.name == "mine" and machine.control_unit == "V"
    assert fields["known_delay"] == 2 and fields["uncertainty"]["gain"] >= 0.02
    assert fields["encoder_resolution"] == pytest.approx(1e-6, rel=1e-3)


def test_a_record_without_periods_measures_no_response(identified):
    """So that `tune` recommends no loop."""
    machine = machine_from(json.dumps(machine_fields(identified, "mine", "V")).encode())
    assert [one.frequency.size for one in machine.measured] == [0, 0]
    assert _unmeasured(machine) == ["X", "Y"]


def test_the_file_has_the_count_of_every_axis_where_they_differ(identified):
    x, y = identified.axes
    mixed = replace(identified, axes=[x, replace(y, resolution=5e-6)])
    each = machine_fields(mixed, "mine", "V")["encoder_resolution"]
    assert each == [x.resolution, 5e-6]
    machine = machine_from(json.dumps(machine_fields(mixed, "mine", "V")).encode())
    assert machine.resolution == pytest.approx(np.array([1e-6, 5e-6]), rel=1e-3)
    alike = replace(identified, axes=[replace(x, resolution=1e-6), replace(y, resolution=1.005e-6)])
    assert counts(alike) == 1.005e-6


def test_the_file_has_the_noise_of_every_encoder(identified):
    """Half a count in the records; none where none was sure."""
    each = machine_fields(identified, "mine", "V")["encoder_noise"]
    assert each == pytest.approx([0.5e-6, 0.5e-6], rel=0.1)
    machine = machine_from(json.dumps(machine_fields(identified, "mine", "V")).encode())
    assert machine.encoder_noise == pytest.approx(np.array(each))
    quiet = replace(identified, axes=[replace(one, encoder_noise=0.0) for one in identified.axes])
    assert machine_fields(quiet, "mine", "V")["encoder_noise"] == 0.0


@pytest.mark.parametrize("off", [0.0, 0.3])
def test_friction_is_known_no_better_than_the_places_of_rest(off):
    """A drive behind 40 um of friction, whose rests are a part of that off, by turns either way."""
    random, friction = np.random.default_rng(0), 40e-6
    targets = np.cumsum(random.uniform(2e-3, 10e-3, 60) * np.tile([1, -1], 30))
    wave = (1 - np.cos(np.pi * np.minimum(np.arange(500) / 300, 1))) / 2  # moves, then rests
    u = np.concatenate([a + (b - a) * wave for a, b in pairwise([0.0, *targets])])
    held, place = np.empty(len(u)), 0.0
    for k, asked in enumerate(u):
        held[k] = place = np.clip(place, asked - friction, asked + friction)
    y = np.append(np.zeros(3), held[:-3])
    rests = (np.arange(len(u)) % 500 > 320) * np.repeat(np.tile([1, 1, -1, -1], 15), 500)
    y = y + off * friction * rests + 1e-7 * random.standard_normal(len(u))
    record = MachineRecord(DT, ("X", "Y"), np.stack([u, u], axis=1), np.stack([y, y], axis=1))
    fields = machine_fields(identify_machine(record, 1, 4), "mine", "m")
    assert fields["friction"] == pytest.approx([friction] * 2, rel=0.05)
    assert fields["friction_known_to"] == pytest.approx([np.hypot(0.1, off)] * 2, rel=0.12)


def test_the_file_doubts_the_response_where_the_intervals_are_wide(identified):
    fields = machine_fields(identified, "mine", "V")
    machine, given = machine_from(json.dumps(fields).encode()), fields["uncertainty"]["response"]
    assert machine.response_uncertainty is not None
    inner = np.array(given["hertz"][1:-1])
    widths = machine.response_uncertainty.at(2 * np.pi * DT * inner)
    for k, one in enumerate(identified.axes):
        own = np.interp(inner, one.response.frequency, one.response.half_width)
        assert (widths[:, k] >= 0.98 * own).all()
    x = identified.axes[0].response  # of an axis that does not ring
    assert max(given["relative"][0]) <= max(0.02, 1.01 * x.half_width.max())


def test_an_identified_resonance_is_no_surer_than_that_of_a_data_sheet(identified):
    """Its frequency 5 % off either way and half of its damping, as `jcontour machine` writes it."""
    machine = machine_from(json.dumps(machine_fields(identified, "mine", "V")).encode())
    hertz, damping = axis_result(identified.axes[1]).resonances[0]
    s = 2j * np.pi * (places := np.linspace(20.0, 90.0, 71))
    said, *true = (
        (w**2 / (s**2 + 2 * z * w * s + w**2))
        for w, z in [
            (2 * np.pi * hertz * part, damping * less)
            for part, less in ((1.0, 1.0), (0.95, 1.0), (0.95, 0.5), (1.05, 0.5))
        ]
    )
    off = np.abs(np.array(true) / said - 1).max(axis=0)
    assert machine.response_uncertainty is not None
    widths = machine.response_uncertainty.at(2 * np.pi * DT * places)
    assert np.all(widths[:, 1] >= 0.97 * off - 1e-3) and off.max() > 0.8


def test_a_file_keeps_the_frequencies_around_a_sharp_mode():
    usual = np.geomspace(1.0, 400.0, 100)
    sharp = 45.0 * (1 + 5e-3 * np.arange(-4, 5))
    kept = _thinned(np.union1d(usual, sharp))
    assert np.isin(sharp, kept).all() and kept.size < 25 + 2 + sharp.size
    np.testing.assert_array_equal(_thinned(usual), usual[::4])


def test_limits_are_those_of_the_record(identified):
    limits = largest(identified)
    assert limits["control"] == np.abs(identified.record.command).max(axis=0).tolist()
    fastest = np.abs(np.diff(identified.record.position, axis=0)).max(axis=0) / DT
    assert (np.array(limits["speed"]) <= fastest * 1.001).all()
    assert (np.array(limits["speed"]) > 0.3 * fastest).all()
    assert min(limits["acceleration"]) > 0
