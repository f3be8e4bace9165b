"""Use of a machine's limits, against loops in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay, zoh
from jcontour.motion.references import along
from jcontour.simulation.limit_use import (
    AxisLimits,
    LimitUse,
    alternating,
    hidden_acceleration,
    limit_use,
)


def test_all_samples_count_scored_or_not_and_the_worst_axis_does():
    random = np.random.default_rng(0)
    output, control = random.normal(size=(12, 2)), random.normal(size=(12, 2))
    scored = np.ones(12, bool)
    scored[[0, 5]] = False
    dt = 0.5
    path = line([0.0, 0.0], [1.0, 0.0])
    reference = along(path, np.linspace(0, 1, 12), dt, 0, at_rest=False, scored=scored)
    limits = AxisLimits(*(np.array([1.0, 4.0]) * k for k in (1.0, 2.0, 3.0, 5.0)))
    use = jax.jit(limit_use)(output, control, reference, limits)
    wanted = dict.fromkeys(LimitUse._fields, 0.0)
    for k in range(12):
        for axis in range(2):
            value = abs(control[k, axis]) / limits.control[axis]
            wanted["control"] = max(wanted["control"], value)
            if k + 1 < 12:
                change = control[k + 1, axis] - control[k, axis]
                speed = (output[k + 1, axis] - output[k, axis]) / dt
                for name, value in (("increment", change), ("speed", speed)):
                    share = abs(value) / getattr(limits, name)[axis]
                    wanted[name] = max(wanted[name], share)
            if k + 2 < 12:
                bend = (output[k + 2] - 2 * output[k + 1] + output[k])[axis] / dt**2
                share = abs(bend) / limits.acceleration[axis]
                wanted["acceleration"] = max(wanted["acceleration"], share)
    for name, value in wanted.items():
        np.testing.assert_allclose(getattr(use, name), value, rtol=1e-12)


def test_what_the_samples_hide_is_added_to_what_they_show():
    """A mass under a force that alternates: its samples stand still."""
    dt, push, hidden = 0.1, 3.0, 0.5
    force = push * (-1.0) ** np.arange(9)[:, None] * np.array([1.0, 0.0]) + [0.0, 2.0]
    still = np.zeros((9, 1))
    path = line([0.0], [1.0])
    reference = along(path, np.linspace(0, 1, 9), dt, 0, at_rest=False)
    limits = AxisLimits(acceleration=np.array([4.0]), hidden=np.array([[hidden, 0.2]]))
    use = limit_use(still, force, reference, limits)
    np.testing.assert_allclose(use.acceleration, hidden * push / 4.0, rtol=1e-12)
    moving = 0.5 * 1.5 * (dt * np.arange(9)[:, None]) ** 2
    use = limit_use(moving, force, reference, limits)
    np.testing.assert_allclose(use.acceleration, (1.5 + hidden * push) / 4.0, rtol=1e-12)
    use = limit_use(moving, force, reference, limits._replace(hidden=None))
    np.testing.assert_allclose(use.acceleration, 1.5 / 4.0, rtol=1e-12)


def test_what_has_no_limit_is_not_used():
    path = line([0.0], [1.0])
    reference = along(path, np.linspace(0, 1, 5), 1.0, 0, at_rest=False)
    use = limit_use(np.ones((5, 1)), np.ones((5, 1)), reference, AxisLimits())
    assert [float(value) for value in use] == [0.0] * 4


def test_slopes_are_those_of_differences():
    """Of a loop of 20 samples, as its program is compiled: values and slopes in one pass."""
    path = line([0.0, 0.0], [1.0, 1.0])
    wanted = 1e-4 * np.cumsum(np.random.default_rng(0).normal(size=(20, 2)), axis=0)
    reference = along(path, np.linspace(0, 1, 20), 2e-3, 0, at_rest=False)
    stated = (np.full(2, limit) for limit in (0.2, 3.7, 300.0, 90.0))
    limits = AxisLimits(*stated, hidden=np.array([[20.0, 0.0], [0.0, 30.0]]))

    def use(gain):
        def step(state, target):
            place, speed = state
            control = gain * (target - place) - 0.3 * speed
            following = place + 1.6e-3 * speed + 4e-4 * control, 0.6 * speed + 0.4 * control
            return following, (following[0], control)

        begin = jnp.zeros(2), jnp.zeros(2)
        _, (output, control) = jax.lax.scan(step, begin, wanted)
        return jnp.stack(limit_use(output, control, reference, limits))

    gains = np.linspace(1.0, 90.0, 50)
    slopes = jax.jit(jax.vmap(jax.jacfwd(use)))(gains)
    h = 1e-5
    value = jax.jit(jax.vmap(use))
    differences = np.subtract(value(gains + h), value(gains - h)) / (2 * h)
    np.testing.assert_allclose(slopes, differences, rtol=1e-6, atol=1e-9)


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
    [[actual]] = hidden_acceleration(sampled(*model))
    np.testing.assert_allclose(actual, max(within - shown, 0.0), rtol=1e-9)


def test_a_mass_hides_all_of_it_and_swings_an_eighth_aside():
    place, _ = swing(*MASS)
    [[actual]] = hidden_acceleration(sampled(*MASS))
    np.testing.assert_allclose(actual, 0.8, rtol=1e-12)
    aside = place[FINE // 2] - 0.5 * (place[0] + place[FINE])
    np.testing.assert_allclose(abs(aside), actual * DT**2 / 8, rtol=1e-9)


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
    [[actual]] = hidden_acceleration(LinearPlant(A, B, np.eye(1, 3), DT))
    np.testing.assert_allclose(actual, within - shown, rtol=1e-9)


def test_a_pure_delay_hides_nothing():
    late = LinearPlant([[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 1.0]], DT)
    assert hidden_acceleration(late).tolist() == [[0.0]]


def test_axes_keep_apart_and_negative_poles_do_not_fail():
    A = np.diag([-0.3, 0.5])
    actual = hidden_acceleration(LinearPlant(A, np.eye(2), np.eye(2), DT))
    assert np.isfinite(actual).all() and actual[0, 1] == actual[1, 0] == 0


def test_a_straight_control_does_not_alternate():
    ramp = np.linspace(0, 3, 7)[:, None] * np.array([1.0, -2.0])
    np.testing.assert_allclose(alternating(ramp), 0, atol=1e-15)
    swinging = np.array([1.0, -1.0] * 4)[:, None]
    np.testing.assert_allclose(alternating(ramp[:1] + 0.3 * swinging), 0.3, rtol=1e-12)
