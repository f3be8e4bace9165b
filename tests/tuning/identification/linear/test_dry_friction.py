"""A mass under a force, with dry friction of much of it: moves of a trapezoid, counted by 1 um."""

import math

import numpy as np
import pytest

from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord
from tuning.identification.linear.output_error import AxisRecord

DT, ROWS, COUNT, LATE = 1e-3, 9000, 1e-6, 1
K, M, B = 40.0, 40.0, 120.0  # [N/A], [kg], [N s/m]
FRICTION = 0.207  # [A] 0.4 of the standard deviation that the command has without it


def asked(random):
    """Moves to random places with up to 1.5 m/s^2, one every 0.5 s [m]."""
    r, place, speed, goal, most = np.zeros(ROWS), 0.0, 0.0, 0.0, 0.1
    for k in range(ROWS):
        if k % 500 == 0:
            goal, most = random.uniform(-0.04, 0.04), random.uniform(0.05, 0.2)
        way = goal - place
        wanted = math.copysign(min(math.sqrt(3.0 * abs(way)), most), way)
        speed += min(max(wanted - speed, -1.5 * DT), 1.5 * DT)
        place += speed * DT
        r[k] = place
    return r


def record(friction, seed):
    """Under loops of the position and the speed; in each of ten parts of a sample it may stick."""
    random = np.random.default_rng(seed)
    r, h = asked(random), DT / 10
    p, gain = math.exp(-B / M * h), K / B
    u, y = np.zeros(len(r)), np.zeros(len(r))
    x = v = seen = total = 0.0
    for k in range(len(r)):
        y[k] = COUNT * round((x + 0.3e-6 * random.standard_normal()) / COUNT)
        seen = 0.7 * seen + 0.3 * ((y[k] - y[k - 1]) / DT if k else 0.0)
        error = 12 * (r[k] - y[k]) - seen
        total += error * DT
        u[k] = 50 * (error + total / 0.15) + 0.02 * random.standard_normal()
        acting = float(u[k - LATE]) if k >= LATE else 0.0
        for _ in range(10):
            net = gain * acting
            free = net + (v - net) * p
            stops = free / (gain * (1 - p))  # command that would end the motion in this part
            net -= gain * min(max(stops, -friction), friction)
            x += (v - net) * M / B * (1 - p) + net * h
            v = net + (v - net) * p
    return AxisRecord(DT, u, y)


def response(frequency):
    """K / (M s^2 + B s) to a held command, exactly, a sample late."""
    tau, p, z = M / B, np.exp(-B / M * DT), np.exp(2j * np.pi * frequency * DT)
    above = K / B * tau * ((DT / tau - 1 + p) * z + 1 - p - DT / tau * p)
    return above / ((z - 1) * (z - p)) * z**-LATE


def test_friction_of_much_of_the_command_leaves_the_model_as_it_is():
    one = record(FRICTION, 1)
    both = MachineRecord(DT, ("X",), one.command[:, None], one.position[:, None])
    found = identify_machine(both, 1, 3).axes[0]
    assert found.friction is not None and found.friction[0] == pytest.approx(FRICTION, rel=0.01)
    some = (found.response.frequency > 0.5) & (found.response.frequency < 30)
    off = np.abs(response(found.response.frequency[some]) / found.response.value[some] - 1)
    assert off.max() < 0.03


def test_a_mass_without_friction_has_none():
    one = record(0.0, 2)
    both = MachineRecord(DT, ("X",), one.command[:, None], one.position[:, None])
    found = identify_machine(both, 1, 3).axes[0]
    assert found.friction is None and found.fit.model.integrators == 1
