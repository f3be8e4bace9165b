"""Pieces in which an axis moves one way, fitted each from a start of its own."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.output_error import AxisRecord, Structure, fitted
from tuning.identification.linear.pieces import (
    Pieces,
    free_start,
    of_starts,
    rows_of,
    short_whitening,
    started_apart,
)

DT = 1e-3
BELOW = np.array([1.0, -1.7, 0.72])


def test_a_part_has_the_pieces_that_reach_into_it():
    whole = Pieces(((0, 100), (150, 300), (400, 500)), 6)
    assert whole.within(90, 290) == Pieces(((60, 200),), 6)


def test_starts_are_all_that_is_taken_out():
    """Free responses and a constant leave nothing; of a sine what least squares by numpy leaves."""
    pieces = Pieces(((10, 90), (120, 400)))
    free = free_start(BELOW, 1, np.ones(1), pieces)
    random = np.random.default_rng(0)
    own = lfilter([1.0], BELOW, np.where(np.isin(np.arange(450), (8, 119)), 1.0, 0.0)) + 3.0
    sine = np.sin(0.3 * np.arange(450)) + 0.1 * random.standard_normal(450)
    left = started_apart(np.stack([own, sine], axis=1), free, pieces, 0)
    assert np.abs(left[:, 0]).max() < 1e-10
    wanted = []
    for start, end in pieces:
        k = np.arange(end - start)
        poles = np.roots(BELOW)
        base = np.stack([poles[0] ** k, poles[1] ** k, k**0.0], axis=1)
        part = sine[start:end]
        wanted.append(part - base @ np.linalg.lstsq(base, part, rcond=None)[0])
    assert np.allclose(left[:, 1], np.concatenate(wanted), atol=1e-9)
    explained = of_starts(sine, BELOW, 1, pieces)
    rows = rows_of(pieces, 0)
    assert np.allclose(explained[rows] + left[:, 1], sine[rows])
    assert np.count_nonzero(explained) <= len(rows)


def test_noise_filter_is_that_of_the_noise():
    """r(k) = 0.5 r(k-1) + e(k), with garbage between the pieces."""
    random = np.random.default_rng(1)
    r = lfilter([1.0], [1.0, -0.5], random.standard_normal(40_000))
    r[1000::2000] = 50.0
    pieces = Pieces(tuple((start + 1001, start + 3000) for start in range(0, 36_000, 2000)))
    assert short_whitening(r, pieces)[1] == pytest.approx(-0.5, abs=0.02)


def test_what_happens_between_pieces_does_not_count():
    """G = 0.02 q^-2 / ((1 - 0.9 q^-1) (1 - q^-1)), thrown about every 200 samples; f = 0.3."""
    random = np.random.default_rng(2)
    u, signs = random.standard_normal(2000), np.ones(2000)
    pieces, x, v = [], 0.0, 0.0
    y = np.zeros(2000)
    for k in range(2000):
        y[k] = x
        turned = k % 200 == 199
        signs[k] = -1.0 if k // 200 % 2 else 1.0
        push = (u[k - 1] if k else 0.0) + 0.3 * signs[k] + (5 * random.standard_normal() * turned)
        v = 0.9 * v + 0.02 * push
        x += v
        if k % 200 == 0:
            pieces.append((k, k + 190))
    noisy = y + 1e-4 * random.standard_normal(2000)
    record = AxisRecord(DT, u, noisy, (signs,), Pieces(tuple(pieces)))
    start = AxisModel(np.array([-0.8]), np.array([0.03, 0.0]), 1, 1, DT)
    fit = fitted(record, Structure(1, 2, 1, 1), np.ones(1), start)
    assert fit.model.denominator[0] == pytest.approx(-0.9, abs=2e-4)
    assert fit.model.numerator == pytest.approx([0.02, 0.0], abs=2e-5)
    assert fit.drag[0] == pytest.approx(0.3, abs=2e-3)
    assert np.sqrt(fit.loss) == pytest.approx(1e-4, rel=0.05)
    assert not fit.residual[195:199].any()
