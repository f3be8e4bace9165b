from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.output_error import (
    BLOCK,
    WHITE,
    AxisRecord,
    simulated,
    triangle_of,
    whitened,
    whitening,
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


LONG = 40_000


def test_the_filter_of_known_noise():
    """The asymptotic deviation of an AR coefficient of order p at the truth is below 1/sqrt(N)."""
    white = np.random.default_rng(0).standard_normal(LONG)
    coloured = np.asarray(lfilter([1.0], [1.0, -1.6, 0.8], white))
    w = whitening(coloured, 12)
    wanted = np.zeros(len(w))
    wanted[:3] = 1.0, -1.6, 0.8
    assert np.abs(w - wanted).max() < 5 / np.sqrt(LONG)
    assert np.var(whitened(coloured, w)) == pytest.approx(1.0, rel=5 * np.sqrt(2 / LONG))


def test_a_drift_is_differenced():
    walk = np.cumsum(np.random.default_rng(1).standard_normal(LONG))
    assert whitening(walk, 8)[1] == pytest.approx(-1.0, abs=0.02)


def test_nothing_left_needs_no_filter():
    assert np.array_equal(whitening(np.zeros(200), 5), [1.0])


@pytest.mark.parametrize("rows", [3, BLOCK - 1, 2 * BLOCK, 5 * BLOCK + 17, 500 * BLOCK + 1])
def test_the_triangle_is_that_of_one_piece(rows):
    random = np.random.default_rng(rows)
    columns = random.standard_normal((rows, 5)) * np.array([1e-6, 1.0, 1e3, 1.0, 1e-3])
    found, wanted = triangle_of(columns), np.linalg.qr(columns, mode="r")
    assert found.shape == wanted.shape
    scale = np.abs(wanted).max(axis=0)
    signs = np.sign(np.diag(found)) * np.sign(np.diag(wanted))
    np.testing.assert_allclose(found / scale, signs[:, None] * wanted / scale, atol=1e-12)
    assert not np.tril(found, -1).any()


def test_nearly_equal_columns_keep_their_difference():
    """The squares of a Gram matrix would lose it: 1e-10 beside 1."""
    random = np.random.default_rng(0)
    one, other = random.standard_normal((2, 10 * BLOCK))
    other -= one * (one @ other) / (one @ one)
    found = triangle_of(np.stack([one, one + 1e-10 * other], axis=1))
    assert abs(found[1, 1]) == pytest.approx(1e-10 * np.linalg.norm(other), rel=1e-5)


def test_no_columns_have_a_triangle_without_any():
    assert triangle_of(np.zeros((1000, 0))).shape == (0, 0)
