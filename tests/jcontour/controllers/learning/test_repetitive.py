"""Repetitive control against reference numbers, and as a plug-in around a cascade."""

import jax
import numpy as np
import pytest

from jcontour.controllers.learning.repetitive import (
    Repetitive,
    RepetitiveFilter,
    moved_positions,
)
from jcontour.motion.references import from_samples
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate

ZERO = -0.3075  # b_printed of the linear-motor drive
STATE = Sensors((0, 2), (1, 3))


def linear_motor_trajectory():
    """One period of 880 samples: a double sum of accelerations."""
    counts = (200, 100, 40, 100, 200, 100, 40, 100)
    signs = (0, 1, 0, -1, 0, -1, 0, 1)
    return np.cumsum(np.cumsum(1.9e-6 * np.repeat(signs, counts)))


@pytest.mark.parametrize(
    ("key", "smoothing"),
    [("max_per_cycle_q_filter", (0.25, 0.5, 0.25)), ("max_per_cycle_q_1", (0.0, 1.0, 0.0))],
)
def test_cycles_are_those_of_the_reference(companions, key, smoothing):
    r = linear_motor_trajectory()
    first = 1e-4 * r / r.max() + 5 * np.diff(r, prepend=0.0)
    learning = np.array([-ZERO, 1 + ZERO**2, -ZERO]) / (1 - ZERO) ** 2
    law = RepetitiveFilter(880, learning, smoothing)

    def sample(memory, e0):
        correction = law.correction(memory)
        error = e0 - correction
        return law.seen(memory, correction, error), error

    run = jax.jit(lambda wanted: jax.lax.scan(sample, law.start(1), wanted)[1])
    errors = run(np.tile(first, 6)[:, None])
    cycles = np.abs(np.asarray(errors)).reshape(6, 880).max(axis=1)
    np.testing.assert_allclose(cycles, companions["repetitive_880"][key], rtol=1e-8)


def test_taps_run_from_the_latest_error_to_the_earliest():
    """Taps that are not symmetric, written out."""
    period, lead, learning, smoothing = 9, 2, np.array([0.1, 0.2, 0.4]), [0.5, 0.3, 0.2]
    law = RepetitiveFilter(period, learning, smoothing, lead)
    error = np.random.default_rng(0).standard_normal(30)

    def sample(memory, e):
        correction = law.correction(memory)
        return law.seen(memory, correction, e[None]), correction[0]

    found = jax.jit(lambda e: jax.lax.scan(sample, law.start(1), e)[1])(error)
    wanted = np.zeros(30)
    for k in range(period + law.behind, 30):
        for q, share in zip((-1, 0, 1), smoothing, strict=True):
            j = k - period + q
            wanted[k] += share * (wanted[j] + learning @ error[j + lead - 1 : j + lead + 2])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14)


def circles(steps, period):
    angle = 2 * np.pi * np.arange(steps + 1) / period
    position = 1e-2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return from_samples(position, tangent, 5e-3, preview=1)


@pytest.mark.slow
def test_a_cascade_learns_its_circle(small_loop):
    """The error of every lap falls: the loop answers with a lead of about four samples."""
    plant, controller, _ = small_loop()
    period, laps = 200, 8
    reference = circles(period * laps, period)
    repeated = Repetitive(controller, STATE, RepetitiveFilter(period, 0.5, lead=20))
    run = simulate(plant, repeated, reference)
    error = np.asarray(reference.position[: period * laps] - run.output)
    laps_rms = np.sqrt(np.mean(error.reshape(laps, -1) ** 2, axis=1))
    assert np.all(np.diff(laps_rms[1:]) < 0) and laps_rms[-1] < 0.1 * laps_rms[1]
    plain = simulate(plant, controller, reference)
    np.testing.assert_allclose(run.output[:period], plain.output[:period], rtol=0, atol=1e-15)


def test_the_plug_in_shifts_what_the_controller_reads():
    sensors = Sensors((2, 0), (), scale=2.0)
    measurement = (np.arange(2.0), np.ones(2))
    shift = jax.jit(lambda seen, by: moved_positions(seen, sensors, by))
    moved = shift(measurement, np.array([4.0, 6.0]))
    np.testing.assert_array_equal(moved[0], [3.0, 1.0])
    np.testing.assert_array_equal(moved[1], [3.0, 1.0])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"period": 10, "learning": np.ones(2)}, "learning: needs an odd number of taps"),
        ({"period": 10, "learning": 1.0, "smoothing": np.ones(4)}, "smoothing: needs an odd"),
        ({"period": 10, "learning": 1.0, "lead": -1}, "lead: needs to be at least zero"),
        ({"period": 500.7, "learning": 0.3}, "period: needs a whole number of samples"),
        ({"period": 500, "learning": 0.3, "lead": 1.5}, "lead: needs a whole number"),
        ({"period": 5, "learning": 1.0, "lead": 4}, "period: needs to be longer than the 5"),
    ],
)
def test_bad_input(arguments, says):
    with pytest.raises(ValueError, match=says):
        RepetitiveFilter(**arguments)
