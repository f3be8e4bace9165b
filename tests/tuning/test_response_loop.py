"""PI control on measured lines: margins recomputed, closed loops simulated by SciPy."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import TransferFunction, lsim

from jcontour.app.files.response_file import read_response
from tuning.response_loop import (
    MeasuredResponse,
    ResponseLoop,
    crossover,
    quickest,
    sensitivity,
    stable,
    tuned,
)

RECORDS = Path(__file__).parents[3] / "shared" / "data" / "records" / "sinumerik_ast"
FREQUENCY = np.geomspace(2, 2000, 300)
MOTOR, LOAD, STIFFNESS, DAMPING = 0.01, 0.008, 900.0, 0.08


def two_masses(s):
    """Speed of a motor over its torque, with a load on a spring."""
    spring = (DAMPING * s + STIFFNESS) * LOAD * s / (LOAD * s**2 + DAMPING * s + STIFFNESS)
    return 1 / (MOTOR * s + spring + 0.05)


LINES = two_masses(2j * np.pi * FREQUENCY) * np.exp(-2j * np.pi * FREQUENCY * 2e-4)


def test_the_loop_has_its_crossover_and_a_better_sensitivity_than_without_filters():
    control = tuned(MeasuredResponse(FREQUENCY, LINES, np.ones(300)), 120.0)
    loop = control.response(FREQUENCY) * LINES
    assert crossover(FREQUENCY, loop) == pytest.approx(120, rel=0.01)
    s = 2j * np.pi * FREQUENCY
    plain = (1 + 1 / (s * control.reset_time)) * LINES
    plain = plain / np.exp(np.interp(np.log(120), np.log(FREQUENCY), np.log(np.abs(plain))))
    assert np.abs(1 / (1 + loop)).max() <= 1.01 * np.abs(1 / (1 + plain)).max()


@pytest.mark.parametrize("gain", [0.5, 2.0, 20.0, 60.0])
def test_lines_tell_a_stable_loop_as_a_simulation_does(gain):
    """The delay of the lines as a second-order Pade, in a step response of the closed loop."""
    late = 2e-4
    above = np.poly1d([late**2 / 12, -late / 2, 1])
    below = np.poly1d([late**2 / 12, late / 2, 1])
    load = np.poly1d([LOAD, DAMPING, STIFFNESS])
    spring = np.poly1d([DAMPING * LOAD, STIFFNESS * LOAD, 0])
    G = load * above, (np.poly1d([MOTOR, 0.05]) * load + spring) * below
    closed = gain * G[0], G[1] + gain * G[0]
    poles = closed[1].roots
    s = 2j * np.pi * np.geomspace(0.5, 1e4, 3000)
    assert stable(gain * G[0](s) / G[1](s)) == bool((poles.real < 0).all())
    time = np.linspace(0, 1.0, 4000)
    _, y, _ = lsim(TransferFunction(closed[0].coeffs, closed[1].coeffs), np.ones(4000), time)
    assert bool(np.abs(y).max() < 3) == bool((poles.real < 0).all())


def test_the_quickest_keeps_its_sensitivity_within_the_deviation():
    deviation = np.where(FREQUENCY > 500, 0.1, 0.02)
    lines = MeasuredResponse(FREQUENCY, LINES, 1 / (1 + 2 * deviation**2))
    control = quickest(lines, 1.5)
    loop = control.response(FREQUENCY) * LINES
    turned = np.exp(2j * np.pi * np.linspace(0, 1, 60))[:, None]
    worst = np.abs(1 / (1 + loop * (1 + deviation * turned))).max()
    assert worst <= 1.5 and worst == pytest.approx(sensitivity(loop, deviation).max(), rel=0.01)


@pytest.mark.skipif(not RECORDS.exists(), reason="the public records are not here")
def test_no_more_sensitive_than_a_commercial_tuning_of_the_same_lines():
    measured = read_response(RECORDS / "AST_AX7.xml")
    lines = read_response(RECORDS / "frf.csv")
    assert np.array_equal(measured.value, lines.value)
    theirs = json.loads((RECORDS / "tuned_by_siemens.json").read_text())
    speed, (low, notch) = theirs["speed_controller"], theirs["current_setpoint_filters"]
    names = "Kp_Nms_per_rad", "Tn_s", "f_hz", "fn", "dn", "dd"
    siemens = ResponseLoop(*(float((speed | low | notch)[name]) for name in names))
    seen = lines.frequency >= 3
    at = crossover(lines.frequency[seen], (siemens.response(lines.frequency) * lines.value)[seen])
    control = tuned(lines.calm, at)
    worst = [
        sensitivity((one.response(lines.frequency) * lines.value)[seen]).max()
        for one in (siemens, control)
    ]
    assert worst[0] == pytest.approx(1.29, abs=0.005)
    assert worst[1] <= worst[0] and control.reset_time < siemens.reset_time
