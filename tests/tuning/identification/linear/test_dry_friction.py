"""A mass under a force, with dry friction of much of it: moves of a trapezoid, counted by 1 um."""

import math

import numpy as np
import pytest

from tuning.identification.linear import evidence
from tuning.identification.linear.friction import friction_of, with_or_without_friction
from tuning.identification.linear.gain_uncertainty import gain_uncertainty
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


def sines_then_moves(random):
    """Small sines that reverse at a crawl, then moves [m]."""
    time = DT * np.arange(ROWS)
    tones = ((1.1, 4e-4), (3.7, 1e-4), (9.0, 4e-5))
    parts = [a * np.sin(2 * np.pi * f * time + random.uniform(0, 6)) for f, a in tones]
    sines = np.sum(parts, axis=0)
    return np.concatenate([sines, sines[-1] + asked(random)])


def record(friction, seed, reference=asked, breakaway=0.0):
    """Under loops of the position and the speed; in each of ten parts of a sample it may stick.

    At rest friction is larger by the part `breakaway`, which falls by 1/e in 5 mm/s (Stribeck).
    """
    random = np.random.default_rng(seed)
    r, h = reference(random), DT / 10
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
            most = friction * (1 + breakaway * math.exp(-((v / 5e-3) ** 2)))
            net -= gain * min(max(stops, -most), most)
            x += (v - net) * M / B * (1 - p) + net * h
            v = net + (v - net) * p
    return AxisRecord(DT, u, y)


def response(frequency):
    """K / (M s^2 + B s) to a held command, exactly, a sample late."""
    tau, p, z = M / B, np.exp(-B / M * DT), np.exp(2j * np.pi * frequency * DT)
    above = K / B * tau * ((DT / tau - 1 + p) * z + 1 - p - DT / tau * p)
    return above / ((z - 1) * (z - p)) * z**-LATE


def test_friction_of_much_of_the_command_leaves_the_model_as_it_is():
    """Delay, friction to 0.1 %, response to 0.1 % up to 30 Hz; most of it within its interval."""
    one = record(FRICTION, 1)
    used, choice = with_or_without_friction(one, COUNT, 1, 3)
    fit = choice.best.fit
    assert used.pieces and fit.model.delay == LATE
    found = friction_of(fit)
    assert found is not None and found[0] == pytest.approx(FRICTION, rel=1e-3)
    answer = evidence.response_of(fit, evidence.estimate_of(fit))
    some = (answer.frequency > 0.5) & (answer.frequency < 30)
    off = np.abs(response(answer.frequency[some]) / answer.value[some] - 1)
    assert off.max() < 1e-3
    assert off.max() < 2 * answer.half_width[some].max()
    assert evidence.dispersion(fit) == 1.0


def test_a_mass_without_friction_has_no_pieces():
    used, choice = with_or_without_friction(record(0.0, 2), COUNT, 1, 3)
    assert not used.pieces and not used.drags and choice.best.fit.model.delay == LATE


@pytest.mark.slow
def test_friction_that_falls_with_the_speed_is_told_by_what_is_fast():
    """Half of the record are small sines, where friction is up to half as much again."""
    one = record(FRICTION, 3, sines_then_moves, breakaway=0.5)
    used, choice = with_or_without_friction(one, COUNT, 1, 3)
    fit = choice.best.fit
    assert min(start for start, _ in used.pieces) >= ROWS
    found = friction_of(fit)
    assert found is not None and found[0] == pytest.approx(FRICTION, rel=2e-3)
    answer = evidence.response_of(fit, evidence.estimate_of(fit))
    some = (answer.frequency > 0.5) & (answer.frequency < 30)
    assert np.abs(response(answer.frequency[some]) / answer.value[some] - 1).max() < 5e-3
    part = used.part(0, len(fit.residual))
    assert gain_uncertainty(part, fit, answer, answer.band)[0] < 0.05  # by halves too
