"""Acceleration between samples, against the same motion at a hundred times the rate."""

import numpy as np
import pytest

from jcontour.linear.between_samples import alternating, hidden_acceleration
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay, zoh

DT, FINE = 2e-3, 100
RATE = np.array([[0.0, 1.0, 0.0], [0.0, -1 / 0.012, 0.4], [0.0, 0.0, -1 / 3e-3]])
ENTRY = np.array([[0.0], [0.0], [30.0]])
QUICK = np.diag([1.0, 1.0, 8.0]) @ RATE, ENTRY  # of the current
FAST = np.array([[0.0, 1.0], [0.0, -1 / 5e-4]]), np.array([[0.0], [1 / 5e-4]])
MASS = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [0.8]])


def sampled(rate, entry):
    A, B = zoh(rate, entry, DT)
    return LinearPlant(A, B, np.eye(1, len(rate)), DT)


def swing(rate, entry, late=0.0):
    """Speed and place at the fine samples of two alternating controls, in the steady swing.

    The control changes after `late` of a sample.
    """
    A, B = (np.asarray(matrix) for matrix in zoh(rate, entry, DT / FINE))
    control = np.where((np.arange(2 * FINE) - round(late * FINE)) % (2 * FINE) < FINE, 1.0, -1.0)
    whole, pushed = np.eye(len(A)), np.zeros(len(A))
    for u in control:
        whole, pushed = A @ whole, A @ pushed + B[:, 0] * u
    # an antisymmetric swing: after half of the period the state is the negative of the first
    half, first = np.eye(len(A)), np.zeros(len(A))
    for u in control[:FINE]:
        half, first = A @ half, A @ first + B[:, 0] * u
    state = np.linalg.solve(-np.eye(len(A)) - half, first)
    rows = []
    for u in control:
        rows.append(state)
        state = A @ state + B[:, 0] * u
    np.testing.assert_allclose(state, rows[0], rtol=1e-9, atol=1e-15)
    rows = np.array([*rows, rows[0]])
    return rows[:, 0], rows @ rate[0]


@pytest.mark.parametrize("model", [(RATE, ENTRY), QUICK, FAST, MASS])
def test_what_is_hidden_is_the_mean_acceleration_less_what_samples_show(model):
    place, speed = swing(*model)
    within = abs(speed[FINE] - speed[0]) / DT
    shown = abs(place[2 * FINE] - 2 * place[FINE] + place[0]) / DT**2
    [[found]] = hidden_acceleration(sampled(*model))
    np.testing.assert_allclose(found, max(within - shown, 0.0), rtol=1e-9)


def test_a_mass_hides_all_of_it_and_swings_an_eighth_aside():
    place, _ = swing(*MASS)
    [[found]] = hidden_acceleration(sampled(*MASS))
    np.testing.assert_allclose(found, 0.8, rtol=1e-12)
    aside = place[FINE // 2] - 0.5 * (place[0] + place[FINE])
    np.testing.assert_allclose(abs(aside), found * DT**2 / 8, rtol=1e-9)


@pytest.mark.parametrize("delay", [1, 4])
def test_a_known_delay_hides_no_more(delay):
    plant = sampled(*QUICK)
    assert hidden_acceleration(plant) > 0
    late = hidden_acceleration(with_input_delay(plant, delay), delay)
    np.testing.assert_allclose(late, hidden_acceleration(plant), rtol=1e-9)


def test_a_control_that_changes_within_the_sample():
    """The last control is a state; the mean is that between two changes."""
    rate, entry = MASS
    late = 0.4
    whole, _ = zoh(rate, entry, DT)
    _, begun = zoh(rate, entry, (1 - late) * DT)
    _, pushed = zoh(rate, entry, late * DT)
    moved, _ = zoh(rate, entry, (1 - late) * DT)
    before = np.asarray(moved) @ np.asarray(pushed)
    A = np.block([[np.asarray(whole), before], [np.zeros((1, 3))]])
    B = np.concatenate([np.asarray(begun), [[1.0]]])
    place, speed = swing(rate, entry, late)
    change = round(late * FINE)
    within = abs(speed[change + FINE] - speed[change]) / DT
    shown = abs(place[2 * FINE] - 2 * place[FINE] + place[0]) / DT**2
    [[found]] = hidden_acceleration(LinearPlant(A, B, np.eye(1, 3), DT))
    np.testing.assert_allclose(found, within - shown, rtol=1e-9)


def test_a_pure_delay_hides_nothing():
    late = LinearPlant([[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 1.0]], DT)
    assert hidden_acceleration(late).tolist() == [[0.0]]


def test_axes_keep_apart_and_negative_poles_do_not_fail():
    A = np.diag([-0.3, 0.5])
    found = hidden_acceleration(LinearPlant(A, np.eye(2), np.eye(2), DT))
    assert np.isfinite(found).all() and found[0, 1] == found[1, 0] == 0


def test_a_straight_control_does_not_alternate():
    ramp = np.linspace(0, 3, 7)[:, None] * np.array([1.0, -2.0])
    np.testing.assert_allclose(alternating(ramp), 0, atol=1e-15)
    swinging = np.array([1.0, -1.0] * 4)[:, None]
    np.testing.assert_allclose(alternating(ramp[:1] + 0.3 * swinging), 0.3, rtol=1e-12)
