from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.hidden_modes import hidden_modes, lasting_hidden_mode
from tuning.identification.linear.output_error import AxisRecord, Structure, fitted

DT, ROWS, POLE = 1e-3, 4000, 0.9


def record(zero, second):
    """White commands, positions behind (1 - zero/q) / ((1 - 0.9/q) (1 - second/q)), white noise."""
    random = np.random.default_rng(7)
    u = random.standard_normal(ROWS)
    y = lfilter([0.0, 1.0, -zero], np.poly([POLE, second]), u)
    return AxisRecord(DT, u, np.asarray(y) + 0.1 * random.standard_normal(ROWS))


def fit_of(one):
    start = AxisModel(np.poly([POLE, 0.5])[1:], np.array([1.0, -0.3]), 0, 0, DT)
    return fitted(one, Structure(2, 2, 0, 0), start=start)


def test_a_pole_that_a_zero_cancels_is_hidden():
    """The axis has one pole: of the two that are fitted the other has no residue."""
    fit = fit_of(record(0.4, 0.4))
    (hidden,) = hidden_modes(fit)
    assert abs(hidden - POLE) > 0.05
    kept = fit.model.poles[fit.model.poles != hidden]
    assert np.abs(kept - POLE).min() < 0.01


@pytest.mark.parametrize("second", [0.5, 0.3])
def test_a_mode_that_the_record_shows_is_not(second):
    assert hidden_modes(fit_of(record(0.4, second))).size == 0


def test_whether_a_mode_is_seen_depends_on_the_noise_of_the_record():
    """Poles 0.9 and 0.5: a zero at 0.494 hides the second one in most records, 0.3 in none."""
    start = AxisModel(np.poly([POLE, 0.5])[1:], np.array([1.0, -0.494]), 0, 0, DT)
    random, seen = np.random.default_rng(3), {0.494: 0, 0.3: 0}
    for zero in seen:
        for _ in range(15):
            u = random.standard_normal(ROWS // 4)
            y = np.asarray(lfilter([0.0, 1.0, -zero], np.poly([POLE, 0.5]), u))
            one = AxisRecord(DT, u, y + 0.3 * random.standard_normal(len(u)))
            seen[zero] += hidden_modes(fitted(one, Structure(2, 2, 0, 0), start=start)).size == 0
    assert seen[0.494] <= 3 and seen[0.3] == 15


def test_a_pair_that_is_seen_is_not_hidden():
    pair = 0.9 * np.exp(1j * np.array([0.4, -0.4]))
    a, random = np.real(np.poly([POLE, *pair])), np.random.default_rng(0)
    u = random.standard_normal(ROWS)
    y = np.asarray(lfilter([0.0, 1.0, -1.0, 0.5], a, u)) + 0.1 * random.standard_normal(ROWS)
    start = AxisModel(a[1:], np.array([1.0, -1.0, 0.5]), 0, 0, DT)
    fit = fitted(AxisRecord(DT, u, y), Structure(3, 3, 0, 0), start=start)
    assert np.iscomplex(fit.model.poles).any() and hidden_modes(fit).size == 0


@pytest.mark.parametrize(("damping", "seen"), [(1e-2, True), (1e-4, False)])
def test_a_pair_without_damping_is_none_of_a_machine(damping, seen):
    """A pair of 80 Hz, s = -z w +- i w sqrt(1 - z^2), however well its record shows it."""
    w = 2 * np.pi * 80 * DT
    pair = np.exp(w * (-damping + np.array([1j, -1j]) * np.sqrt(1 - damping**2)))
    a, random = np.real(np.poly(pair)), np.random.default_rng(1)
    u = random.standard_normal(ROWS)
    y = np.asarray(lfilter([0.0, 1.0, 0.5], a, u)) + 0.1 * random.standard_normal(ROWS)
    start = AxisModel(a[1:], np.array([1.0, 0.5]), 0, 0, DT)
    fit = fitted(AxisRecord(DT, u, y), Structure(2, 2, 0, 0), start=start, iterations=0)
    assert (hidden_modes(fit).size == 0) is seen


def test_a_model_without_poles_has_none():
    one = record(0.4, 0.4)
    assert hidden_modes(fitted(one, Structure(0, 1, 0, 0))).size == 0


@pytest.mark.parametrize(("second", "lasts"), [(0.4, False), (0.99, False), (1 - 1e-4, True)])
def test_a_hidden_mode_lasts_where_its_pole_is_1_to_less_than_the_record(second, lasts):
    """A zero on the second pole, which dies out in 10^4 of 4000 samples; or in 100, or in two."""
    one = record(second, second)
    start = AxisModel(np.poly([POLE, second])[1:], np.array([1.0, -second]), 0, 0, DT)
    fit = fitted(one, Structure(2, 2, 0, 0), start=start, iterations=0)
    assert np.abs(hidden_modes(fit) - second).min() < 1e-6
    assert lasting_hidden_mode(fit) is lasts


def test_in_pieces_a_mode_lasts_that_outlives_their_mean():
    """The pole 0.99 dies out in 100 samples: not within pieces of 60 and 80."""
    one, pole = record(0.99, 0.99), np.array([1.0, -0.99])
    start = AxisModel(np.poly([POLE, 0.99])[1:], pole, 0, 0, DT)
    fit = fitted(one, Structure(2, 2, 0, 0), start=start, iterations=0)
    rows = np.concatenate([np.arange(100, 160), np.arange(200, 280)])
    cut = replace(fit, rows=rows, errors=fit.errors[rows], jacobian=fit.jacobian[rows])
    assert np.abs(hidden_modes(cut) - 0.99).min() < 1e-6
    assert lasting_hidden_mode(cut)
