from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.noise_model import WHITE
from tuning.identification.linear.output_error import (
    AxisRecord,
    simulated,
    with_slopes,
)

DT, ROWS = 1e-3, 3000
TRUTH = AxisModel(np.array([-1.7, 0.75]), np.array([1e-4, 2e-4, -5e-5]), 1, 2, DT)


def record(noise=0.0, friction=0.0):
    random = np.random.default_rng(0)
    u = np.repeat(random.standard_normal(ROWS // 10), 10)
    signs = np.sign(np.sin(np.arange(ROWS) / 40.0))
    y = np.asarray(lfilter(TRUTH.above, TRUTH.below, u)) + 0.3
    at_once = TRUTH.above[TRUTH.delay :]  # friction does not wait for the command's delay
    y = y + friction * np.asarray(lfilter(at_once, TRUTH.below, signs))
    y = y + noise * random.standard_normal(ROWS)
    return AxisRecord(DT, u, y, (signs,) if friction else ())


def test_friction_acts_without_the_delay_of_the_command():
    one = record(friction=0.4)
    fit = simulated(one, TRUTH, drag=np.array([0.4]))
    assert np.abs(fit.residual).max() < 1e-9 * np.ptp(one.position)


def test_motion_from_before_the_record_is_no_fault_of_the_model():
    whole = record()
    fit = simulated(whole.part(1000, 3000), TRUTH)
    assert np.abs(fit.residual).max() < 1e-9 * np.ptp(whole.position)
    assert np.abs(simulated(whole.part(500, 2000), fit.model).errors).max() < 1e-9


@pytest.mark.parametrize("w", [WHITE, np.array([1.0, -0.7, 0.1])])
def test_slopes_by_differences(w):
    """Of the errors with the motion before the record held fixed at its least-squares values."""
    one = record(friction=0.2)  # the errors are nothing, and their second slopes do not count
    fit = with_slopes(one, TRUTH, np.array([0.2]), w)
    own, rest = fit.jacobian[:, :6], fit.jacobian[:, 6:]

    def beside(columns):  # what the linear part cannot take up
        return columns - rest @ np.linalg.lstsq(rest, columns, rcond=None)[0]

    for k in range(6):
        step = 1e-6 if k < 2 else 1e-9 if k < 5 else 1e-6
        a, b, f = TRUTH.denominator.copy(), TRUTH.numerator.copy(), 0.2
        if k < 2:
            a[k] += step
        elif k < 5:
            b[k - 2] += step
        else:
            f += step
        model = replace(TRUTH, denominator=a, numerator=b)
        moved = with_slopes(one, model, np.array([f]), w)
        slope = (moved.errors - fit.errors) / step
        wanted = beside(own[:, k])
        assert np.abs(slope - wanted).max() < 2e-3 * np.abs(wanted).max()
