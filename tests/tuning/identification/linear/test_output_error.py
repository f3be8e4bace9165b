from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.noise_model import WHITE
from tuning.identification.linear.output_error import (
    AxisRecord,
    Structure,
    fitted,
    predicted,
    simulated,
    started,
)

DT, ROWS = 1e-3, 3000
TRUTH = AxisModel(np.array([-1.7, 0.75]), np.array([1e-4, 2e-4, -5e-5]), 1, 2, DT)
STRUCTURE = Structure(2, 3, 1, 2)


def record(noise=0.0, friction=0.0):
    random = np.random.default_rng(0)
    u = np.repeat(random.standard_normal(ROWS // 10), 10)
    signs = np.sign(np.sin(np.arange(ROWS) / 40.0))
    y = np.asarray(lfilter(TRUTH.above, TRUTH.below, u)) + 0.3
    at_once = TRUTH.above[TRUTH.delay :]  # friction does not wait for the command's delay
    y = y + friction * np.asarray(lfilter(at_once, TRUTH.below, signs))
    y = y + noise * random.standard_normal(ROWS)
    return AxisRecord(DT, u, y, (signs,) if friction else ())


def test_without_noise_the_truth_is_found():
    found = fitted(record(), STRUCTURE).model
    assert np.allclose(found.denominator, TRUTH.denominator, rtol=1e-6)
    assert np.allclose(found.numerator, TRUTH.numerator, rtol=1e-6)


def test_the_start_alone_is_right_without_noise():
    assert np.allclose(started(record(), STRUCTURE).denominator, TRUTH.denominator, rtol=1e-4)


def test_friction_acts_without_the_delay_of_the_command():
    found = fitted(record(friction=0.4), STRUCTURE)
    assert found.drag == pytest.approx([0.4], rel=1e-6)
    assert np.allclose(found.model.numerator, TRUTH.numerator, rtol=1e-5)


def test_motion_from_before_the_record_is_no_fault_of_the_model():
    whole = record()
    fit = simulated(whole.part(1000, 3000), TRUTH)
    assert np.abs(fit.residual).max() < 1e-9 * np.ptp(whole.position)
    assert np.abs(predicted(whole.part(500, 2000), fit, WHITE)).max() < 1e-9


@pytest.mark.parametrize("w", [WHITE, np.array([1.0, -0.7, 0.1])])
def test_slopes_by_differences(w):
    """Of the errors with the motion before the record held fixed at its least-squares values."""
    one = record(friction=0.2)  # the errors are nothing, and their second slopes do not count
    fit = fitted(one, STRUCTURE, w, TRUTH, iterations=0, drag=np.array([0.2]))
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
        moved = fitted(one, STRUCTURE, w, model, iterations=0, drag=np.array([f]))
        slope = (moved.errors - fit.errors) / step
        wanted = beside(own[:, k])
        assert np.abs(slope - wanted).max() < 2e-3 * np.abs(wanted).max()


def test_the_least_squares_deviation_is_reached():
    """Over repeated noise the spread of an estimate is (J'J)^-1 s^2, and its mean the truth."""
    noise, found = 2e-4, []
    clean = record()
    for seed in range(40):
        extra = noise * np.random.default_rng(seed).standard_normal(ROWS)
        one = replace(clean, position=clean.position + extra)
        found.append(fitted(one, STRUCTURE, start=TRUTH).model.denominator)
    J = fitted(clean, STRUCTURE, start=TRUTH).jacobian
    deviation = noise * np.sqrt(np.diag(np.linalg.inv(J.T @ J))[:2])
    assert np.allclose(np.std(found, axis=0), deviation, rtol=0.35)
    assert (np.abs(np.mean(found, axis=0) - TRUTH.denominator) < deviation).all()
