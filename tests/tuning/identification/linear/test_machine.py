import math
from dataclasses import replace

import numpy as np
import pytest

from tuning.identification.linear import machine, validation
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord
from tuning.identification.linear.output_error import AxisRecord
from tuning.identification.linear.rigid_axis import simplest
from tuning.identification.linear.validation import Response

DT, ROWS = 1e-3, 8000


def reference(seed):
    return np.repeat(np.random.default_rng(seed).uniform(-0.01, 0.01, ROWS // 80), 80)


def test_the_plant_is_the_machine(found):
    assert found.known_delay == 2 and [one.fit.model.delay for one in found.axes] == [2, 3]
    plant = found.plant()
    z = np.exp(1j * 2 * np.pi * 10 * DT)
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    G = C @ np.linalg.solve(z * np.eye(len(A)) - A, B)
    for k, (constant, more) in enumerate(((0.010, 0), (0.015, 1))):
        s = 2j * np.pi * 10
        hold = np.exp(-s * DT / 2)  # of a held command, to second order
        wanted = 0.02 / (s * (constant * s + 1)) * hold * z**-more
        assert abs(G[k, k] / wanted - 1) < 0.01
    assert G[0, 1] == G[1, 0] == 0


def test_the_family_is_no_smaller_than_a_drive_repeats(found):
    assert 0.02 <= found.gain < 0.2 and found.late in (0, 1)


def test_what_the_record_hides_is_said_with_advice(found):
    """Steps show both axes up to some 60 Hz; with a record that shows 100 Hz nothing is hidden."""
    assert all(one.unseen for one in found.axes)
    assert sum(one.fit.model.order for one in found.axes) == 4
    assert 40.0 < found.shown_to == min(one.response.band[1] for one in found.axes)
    for one in found.axes:
        shown = replace(one.response, half_width=np.full(len(one.response.frequency), 0.01))
        assert not replace(one, response=shown).unseen


def test_a_reversed_command_is_refused(record):
    """Beside friction it would give a model that friction drives."""
    for friction in (0.0, 0.1):
        position = record.position[:, :1]
        speed = np.gradient(position, axis=0)
        drag = friction * record.command.std() * np.sign(speed)
        first = replace(
            record, axes=("X",), command=-(record.command[:, :1] + drag), position=position
        )
        with pytest.raises(ValueError, match="X: the position falls where the command rises"):
            identify_machine(first, 1, 3)


def test_lines_that_are_dropped_still_bound_what_is_known(record, monkeypatch):
    """A model of a mass is not known where the lines that it misses are."""
    first = replace(
        record, axes=("X",), command=record.command[:, :1], position=record.position[:, :1]
    )
    monkeypatch.setattr(machine, "_enough", lambda *_: False)
    monkeypatch.setattr(machine, "_fitted", lambda *_: None)
    monkeypatch.setattr(machine.nonparametric, "agreed_to", lambda *_: 20.0)
    (axis,) = identify_machine(first, 1, 3).axes
    assert 10.0 < axis.response.band[1] <= 20.0


@pytest.mark.slow
def test_what_hides_much_and_is_no_noise_is_refused(record, monkeypatch):
    """Something turns every second and moves the axis about half as fast as its command does."""
    push = np.where(np.arange(ROWS) // 1000 % 2, 1.0, -1.0).cumsum() * 3e-5
    position = record.position[:, :1] + push[:, None]
    lost = replace(record, axes=("X",), command=record.command[:, :1], position=position)
    monkeypatch.setattr(validation, "dispersion", lambda fit: 9.0)
    with pytest.raises(ValueError, match="X: DO NOT USE: the model explains 6"):
        identify_machine(lost, 2, 5)


def test_what_cannot_be_used_is_refused(record):
    still = replace(record, command=np.zeros_like(record.command))
    with pytest.raises(ValueError, match="X: the command never changes"):
        identify_machine(still, 2, 2)
    holes = replace(record, position=np.where(record.position > 0, record.position, np.nan))
    with pytest.raises(ValueError, match="X: the position holds NaN"):
        identify_machine(holes, 2, 2)
    short = replace(record, command=record.command[:100], position=record.position[:100])
    with pytest.raises(ValueError, match="at least 500 samples"):
        identify_machine(short, 2, 2)


@pytest.mark.slow
def test_crossed_columns_are_refused(record):
    crossed = replace(
        record, axes=("X",), command=record.command[:, :1], position=record.position[:, 1:]
    )
    with pytest.raises(ValueError, match="are the columns those of one"):
        identify_machine(crossed, 1, 2)


@pytest.mark.slow
def test_an_axis_that_runs_away_without_its_loop_is_refused(record):
    """y(k+1) = 1.02 y(k) + 0.02 u(k), held by u = 8 (r - y)."""
    random, asked = np.random.default_rng(4), reference(5)
    u, y = np.zeros(ROWS), np.zeros(ROWS)
    for k in range(ROWS - 1):
        u[k] = 8 * (asked[k] - y[k]) + 2e-3 * random.standard_normal()
        y[k + 1] = 1.02 * y[k] + 0.02 * u[k] + 1e-6 * random.standard_normal()
    both = replace(record, command=np.stack([u, u], axis=1), position=np.stack([y, y], axis=1))
    with pytest.raises(ValueError, match="X: what fits is unstable, it grows by 2 % a sample"):
        identify_machine(both, 1, 2)


@pytest.fixture(scope="module")
def joint():
    """A joint under a slow sine: friction and a ripple over the angle take most of its command."""
    dt, w, (m, c, f) = 0.0107, 2 * np.pi * 0.1, (0.08, 0.2, 0.31)
    time = dt * np.arange(5900)
    speed, bend = 0.75 * w * np.cos(w * time), -0.75 * w**2 * np.sin(w * time)
    position = 1e-5 * np.round(0.75 * np.sin(w * time) / 1e-5)
    command = m * bend + c * speed + f * np.sign(speed) + 0.1 * np.sin(60 * position)
    noise = 0.005 * np.random.default_rng(0).standard_normal(len(time))
    return MachineRecord(dt, ("X",), (command + noise)[:, None], position[:, None])


def test_a_ripple_over_the_angle_leaves_the_friction_of_a_joint(joint):
    (one,) = identify_machine(joint, 3, 10).axes
    model = one.fit.model
    gain = model.numerator.sum() / (1 + model.denominator.sum()) / joint.dt
    assert gain == pytest.approx(1 / 0.2, rel=0.15)
    assert one.friction is not None and one.friction[0] == pytest.approx(0.31, rel=0.05)


def test_lines_whose_model_has_another_slow_motion_mislead(joint):
    """A hundredth of the response; friction takes so much that no linear model gives the motion."""
    record = AxisRecord(joint.dt, joint.command[:, 0], joint.position[:, 0])
    simple, hertz = simplest(record, 1e-5, 3), 0.1 + 0.2 * np.arange(40)
    assert simple is not None and simple.explained > 0.9
    value = 0.01 * simple.fit.model.response(2 * np.pi * hertz)
    lines = Response(hertz, value, np.full(40, 0.05))
    assert machine._fitted(record, lines, simple, 3, 3, machine.WORSE_THAN_LINES) is None


@pytest.mark.slow
def test_a_resonance_is_found_on_an_axis_that_sticks_between_its_moves():
    """Motor 60 kg, load 30 kg and an antiresonance of 45 Hz, hence a resonance of 45 sqrt(1.5)."""
    rows, parts, random = 40_000, 8, np.random.default_rng(0)
    phases = 2 * np.pi * random.random(399)[:, None]
    sines = np.cos(np.pi * np.arange(1, 400)[:, None] * DT * np.arange(2000) + phases).sum(axis=0)
    sines = np.append(np.tile(60.0 * sines / sines.std(), 6), np.zeros(rows - 12_000))
    time = DT * np.arange(rows)
    knots, part = random.uniform(0.0, 0.2, 42), np.minimum(time % 1.0 / 0.8, 1.0)
    begin = time.astype(int)
    wanted = knots[begin] + np.diff(knots)[begin] * part**3 * (10 - 15 * part + 6 * part**2)
    wanted[:12_000] = 0.01 * time[:12_000]
    spring, step = 30 * (2 * np.pi * 45) ** 2, DT / parts
    damping = 0.04 * np.sqrt(20 * spring)
    x, y, v, w, before = wanted[0], wanted[0], 0.0, 0.0, wanted[0]
    command, position = np.zeros(rows), np.zeros(rows)
    for k, noise in enumerate(0.4e-6 * random.standard_normal(rows)):
        position[k] = counted = 1e-6 * np.round((x + noise) / 1e-6)
        command[k] = 3000 * (40 * (wanted[k] - counted) - (counted - before) / DT) + sines[k]
        before, u = counted, float(command[k])
        for _ in range(parts):
            force = spring * (x - y) + damping * (v - w)
            v += step * (u - force - 40 * math.tanh(v / 1e-3)) / 60
            w += step * (force - 20 * w) / 30
            x, y = x + step * v, y + step * w
    record = MachineRecord(DT, ("X",), command[:, None], position[:, None])
    (one,) = identify_machine(record, 3, 10).axes
    poles = one.fit.model.poles
    (pair,) = poles[np.imag(poles) > 0]
    assert abs(np.log(pair)) / (2 * np.pi * DT) == pytest.approx(45 * np.sqrt(1.5), rel=0.01)
    assert one.friction is not None and one.friction[0] == pytest.approx(40.0, rel=0.05)
