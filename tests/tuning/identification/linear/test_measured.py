"""The response by spectra, against the true one of a simulated axis."""

import numpy as np
import pytest

from tuning.identification.estimates import Estimate
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.measured import measured, related
from tuning.identification.linear.output_error import AxisRecord, simulated
from tuning.identification.linear.simplest import Simple

DT, ROWS = 1e-3, 20_000
TRUTH = AxisModel(np.array([-1.7, 0.9]), np.array([0.02, 0.01]), 0, 2, DT)

WRONG = AxisModel(np.array([-1.6, 0.8]), np.array([0.03, 0.01]), 0, 2, DT)  # of another mode


@pytest.fixture(scope="module")
def lines():
    """Of an excited axis with friction and a little noise, beside a model of another mode."""
    random = np.random.default_rng(2)
    command, signs = random.standard_normal((2, ROWS))
    record = AxisRecord(DT, command, np.zeros(ROWS), (np.sign(signs),))
    late = np.concatenate([np.zeros(2), command[:-2]]) + 0.4 * np.sign(signs)
    answer = np.convolve(late, impulse())[:ROWS] + 0.002 * random.standard_normal(ROWS)
    record = AxisRecord(DT, command, answer, (np.sign(signs),))
    return measured(beside(record, WRONG, np.array([0.4])))


def beside(record, model, drag):
    """A simple model of a record."""
    estimate = Estimate((), np.zeros(0), np.zeros((0, 0)))
    return Simple(record, simulated(record, model, drag=drag), estimate, np.zeros(0), 1.0)


def impulse():
    """Of the axis without its delay."""
    h = np.zeros(400)
    for k in range(1, 400):
        h[k] = 1.7 * h[k - 1] - 0.9 * h[k - 2] + (0.02 if k == 1 else 0.01 if k == 2 else 0.0)
    return h


def test_the_intervals_hold_the_true_response(lines):
    truth = TRUTH.response(2 * np.pi * lines.frequency)
    inside = np.abs(truth / lines.value - 1) < lines.half_width + 0.02  # a window blurs the mode
    assert lines.frequency[-1] > 250 and inside.mean() > 0.9


def test_nothing_is_kept_where_nothing_moves():
    record = AxisRecord(DT, np.sin(np.arange(ROWS) * 0.05), np.zeros(ROWS))
    noise = 1e-3 * np.random.default_rng(0).standard_normal(ROWS)
    record = AxisRecord(DT, record.command, record.command + noise)
    found = measured(beside(record, AxisModel(np.zeros(0), np.ones(1), 0, 0, DT), None))
    assert np.all(found.frequency < 15)  # the sine has 8 Hz


def test_columns_that_have_nothing_in_common():
    one, other = np.random.default_rng(3).standard_normal((2, ROWS))
    assert not related(AxisRecord(DT, one, np.cumsum(other)))
    assert related(AxisRecord(DT, one, np.cumsum(one + 3 * other)))
