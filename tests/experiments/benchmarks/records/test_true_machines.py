"""The simulator of hidden machines against closed forms, and a way from its record to a model."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.benchmarks.records.true_machines import Moving, response
from experiments.benchmarks.records.whole_way import Way, machine, recorded
from jcontour.app.machines.identified import machine_fields
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.output_error import AxisRecord
from tuning.identification.linear.rigid_axis import simplest
from tuning.identification.linear.validation import resolution_of

DT = 1e-3


@pytest.fixture(scope="module")
def axis():
    """60 kg and 30 kg on 55 Hz of damping 0.02, 8 um of backlash, 1.4 ms late."""
    return machine(0)[2][0]


def test_the_linear_response_is_that_of_two_masses_on_a_spring(axis):
    hertz = np.array([2.0, 10.0, 40.0, 55.0, 90.0])
    s = 2j * np.pi * hertz
    (m, load, _), k, c = axis.masses, axis.stiffness[0], axis.damping[0]
    joint = c * s + k
    below = m * s**2 + axis.viscous[0] * s + joint - joint**2 / (load * s**2 + joint)
    held = (1 - np.exp(-s * DT)) / (s * DT) * np.exp(-axis.delay * s) / (1 + axis.current * s)
    wanted = axis.force * held / below
    assert response(axis, DT, 2 * np.pi * hertz * DT) == pytest.approx(wanted, rel=0.03)


def test_friction_holds_and_slides(axis):
    """Half of what breaks away moves nothing; twice of it slides at (F - F_c) / m at first."""
    one = replace(axis, gap=0.0, count=0.0, viscous=(0.0, 0.0, 0.0), delay=0.0)
    dry = sum(one.coulomb)
    ends = []
    for part in (0.5, 2.0):
        moving = Moving(one, DT)
        for _ in range(200):
            moving.step(part * dry / one.force)
        ends.append(moving.exact)
    assert abs(ends[0]) < 20e-6  # the spring gives way
    assert ends[1] == pytest.approx(dry / sum(one.masses) / 2 * 0.2**2, rel=0.02)


def test_a_record_of_the_excitation_shows_the_machine(axis):
    """The mode, the friction, and an interval that a tuned loop may trust."""
    _, dt, axes = machine(0)
    identified = identify_machine(recorded(axes, dt, 0), 3, 4)
    one = identified.axes[0]
    assert one.friction is not None
    assert one.friction[0] == pytest.approx(60.0 / 35.0, rel=0.02)
    rates = np.log(one.fit.model.poles[np.imag(one.fit.model.poles) > 0]) / dt
    assert np.abs(rates) / (2 * np.pi) == pytest.approx(55.0, rel=0.01)
    uncertainty = machine_fields(identified, "two masses", "A")["uncertainty"]["response"]
    hertz, stated = np.array(uncertainty["hertz"]), np.array(uncertainty["relative"])[0]
    inside = (hertz > 2) & (hertz < 200)
    off = response(axis, dt, 2 * np.pi * hertz * dt) / one.fit.model.response(2 * np.pi * hertz)
    assert np.all(np.abs(off - 1)[inside] <= stated[inside] + 0.01)


def test_what_fails_is_named():
    good = Way(0, "", "USE THESE VALUES", "", True, 0.5, 1.8, 1.0, 1.1, 9e-6, 2e-6, 100.0, 1e-6)
    assert good.fails == ""
    bad = replace(good, stable=False, rings=2.0, sensitivity=np.inf, rms=1.2, peak=np.nan)
    for word in ("unstable", "rings", "Ms inf", "RMS x 1.20", "peak x nan"):
        assert word in bad.fails


@pytest.mark.parametrize(("more", "cogging"), [(0.0, 0.0), (0.4, 4.0)])
def test_friction_that_is_larger_at_rest_is_found_where_it_is(axis, more, cogging):
    """Beside dry friction of 60 N, 24 N that fall as exp(-(v / 6 mm/s)^2): half at 5 mm/s."""
    static = tuple((1 + more) * one for one in axis.coulomb)
    one = replace(axis, gap=0.0, count=1e-7, static=static, stribeck=6e-3, cogging=cogging)
    log = recorded([one, one], DT, 3)
    record = AxisRecord(DT, log.command[:, 0], log.position[:, 0])
    found = simplest(record, resolution_of(record.position), 4)
    assert found is not None and found.fit.drag[0] == pytest.approx(60 / 35, rel=0.01)
    assert found.ripple == pytest.approx(cogging / 35, rel=0.1, abs=0.01 * 60 / 35)
    if not more:
        assert found.stribeck is None
        return
    assert found.stribeck is not None
    assert found.stribeck[0] == pytest.approx(24 / 35, rel=0.1)
    assert found.stribeck[1] == pytest.approx(5e-3, rel=0.2)
