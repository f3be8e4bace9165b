"""Repetitive control against reference numbers, and as a plug-in around a cascade.

What repetitive control and cancellation of run-out share, on a learner that counts.

Cancellation of run-out against reference numbers, and around a cascade.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controller import Controller
from jcontour.controllers.learning.repetitive import (
    Canceller,
    ErrorDriven,
    ErrorDrivenMemory,
    Repetitive,
    RepetitiveFilter,
    RunoutCancelled,
    moved_positions,
)
from jcontour.geometry.contours import line
from jcontour.motion.references import from_samples
from jcontour.plants.actuation import Disturbed
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

ZERO = -0.3075  # b_printed of the linear-motor drive
STATE = Sensors((0, 2), (1, 3))
COMPANIONS = numbers_of("adaptive/companions")


def linear_motor_trajectory():
    """One period of 880 samples: a double sum of accelerations."""
    counts = (200, 100, 40, 100, 200, 100, 40, 100)
    signs = (0, 1, 0, -1, 0, -1, 0, 1)
    return np.cumsum(np.cumsum(1.9e-6 * np.repeat(signs, counts)))


@pytest.mark.parametrize(
    ("key", "smoothing"),
    [("max_per_cycle_q_filter", (0.25, 0.5, 0.25)), ("max_per_cycle_q_1", (0.0, 1.0, 0.0))],
)
def test_cycles_are_those_of_the_reference(key, smoothing):
    r = linear_motor_trajectory()
    first = 1e-4 * r / r.max() + 5 * np.diff(r, prepend=0.0)
    learning = np.array([-ZERO, 1 + ZERO**2, -ZERO]) / (1 - ZERO) ** 2
    law = RepetitiveFilter(880, learning, smoothing)

    def sample(memory, e0):
        correction = law.correction(memory)
        error = e0 - correction
        return law.updated(memory, correction, error), error

    run = jax.jit(lambda wanted: jax.lax.scan(sample, law.start(1), wanted)[1])
    errors = run(np.tile(first, 6)[:, None])
    cycles = np.abs(np.asarray(errors)).reshape(6, 880).max(axis=1)
    np.testing.assert_allclose(cycles, COMPANIONS["repetitive_880"][key], rtol=1e-8)


def test_taps_run_from_the_latest_error_to_the_earliest():
    """Taps that are not symmetric, written out."""
    period, lead, learning, smoothing = 9, 2, np.array([0.1, 0.2, 0.4]), [0.5, 0.3, 0.2]
    law = RepetitiveFilter(period, learning, smoothing, lead)
    error = np.random.default_rng(0).standard_normal(30)

    def sample(memory, e):
        correction = law.correction(memory)
        return law.updated(memory, correction, e[None]), correction[0]

    actual = jax.jit(lambda e: jax.lax.scan(sample, law.start(1), e)[1])(error)
    wanted = np.zeros(30)
    for k in range(period + law.behind, 30):
        for q, share in zip((-1, 0, 1), smoothing, strict=True):
            j = k - period + q
            wanted[k] += share * (wanted[j] + learning @ error[j + lead - 1 : j + lead + 2])
    np.testing.assert_allclose(actual, wanted, rtol=0, atol=1e-14)


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
        ({"period": 10, "learning": 1.0, "lead": -1}, "lead: needs a whole number of at least 0"),
        ({"period": 500.7, "learning": 0.3}, "period: needs a whole number"),
        ({"period": 500, "learning": 0.3, "lead": 1.5}, "lead: needs a whole number"),
        ({"period": 5, "learning": 1.0, "lead": 4}, "period: needs to be longer than the 5"),
    ],
)
def test_bad_input(arguments, says):
    with pytest.raises(ValueError, match=says):
        RepetitiveFilter(**arguments)


class SumOfErrors(ErrorDriven):
    """Learns the sum of the errors, and leaves the control alone."""

    controller: Controller
    sensors: Sensors

    def initial_learned(self, axes: int) -> Any:
        return jnp.zeros(axes)

    def step(self, memory, plan, measurement):
        inner, control = self.controller.step(memory.inner, plan.inner, measurement)
        return ErrorDrivenMemory(memory.learned + self.error(plan, measurement), inner), control


def test_the_wrapped_controller_runs_and_the_errors_are_seen(small_loop):
    plant, controller, reference = small_loop()
    wrapped = SumOfErrors(controller, Sensors((0, 2), (1, 3)))
    run, plain = (simulate(plant, one, reference) for one in (wrapped, controller))
    np.testing.assert_array_equal(run.control, plain.control)
    error = np.asarray(reference.position[: reference.steps] - plain.output)
    np.testing.assert_allclose(run.final_memory.learned, error.sum(axis=0), atol=1e-15)


@pytest.mark.parametrize("degrees", ["0", "60", "85", "95"])
def test_what_is_left_is_that_of_the_reference(degrees):
    w = 2 * np.pi / 40
    canceller = Canceller(w, np.deg2rad(float(degrees)) - w, 0.05)

    def sample(carry, k):
        memory, control = carry
        y = control + jnp.sin(w * k + 0.7)
        memory, control = canceller.step(memory, -y)
        return (memory, control), y

    start = (canceller.start(1), np.zeros(1))
    _, y = jax.jit(lambda k: jax.lax.scan(sample, start, k))(np.arange(600.0))
    left = np.sqrt(np.mean(np.asarray(y)[-40:] ** 2))
    np.testing.assert_allclose(left, COMPANIONS["runout_afc"][degrees], rtol=1e-8)


@pytest.mark.slow
def test_a_cascade_rid_of_two_harmonics(small_loop):
    """The phase is that of the loop from the control to the position, by a dense response."""
    plant, controller, _ = small_loop()
    steps = 3000
    ahead, contour = np.tile([1.0, 0.0], (steps + 1, 1)), line([0.0, 0.0], [0.1, 0.0])
    still = from_samples(np.zeros((steps + 1, 2)), ahead, 5e-3, 1, contour, in_motion=False)
    w = 2 * np.pi * np.array([1, 2]) / 50
    k = np.arange(steps)[:, None]
    force = jnp.asarray(0.3 * np.sin(k * w[0] + 0.3) + 0.1 * np.sin(k * w[1]) + np.zeros((1, 2)))
    impulse = jnp.zeros((steps, 2)).at[0].set(1.0)
    answer = np.asarray(simulate(Disturbed(plant, force=impulse), controller, still).output)
    phases = np.angle(np.exp(-1j * w[:, None] * np.arange(steps)) @ answer[:, 0])
    loaded = Disturbed(plant, force=force)
    before = np.asarray(simulate(loaded, controller, still).output)[-100:]
    cancelled = RunoutCancelled(controller, STATE, Canceller(w, phases, 0.2))
    after = np.asarray(simulate(loaded, cancelled, still).output)[-100:]
    assert np.abs(after[:, 0]).max() < 0.01 * np.abs(before[:, 0]).max()


@pytest.mark.parametrize("frequency", [0.0, 3.2, -0.1])
def test_bad_frequencies(frequency):
    with pytest.raises(ValueError, match="frequency: needs to be above zero and below pi"):
        Canceller(frequency, 0.0, 0.1)


def test_a_bad_gain():
    with pytest.raises(ValueError, match="gain: needs to be finite and at least zero"):
        Canceller(0.1, 0.0, -1.0)


@pytest.mark.parametrize("phase", [[0.0, 1.0, 2.0], np.array([[0.1]]), []])
def test_a_phase_for_each_frequency(phase):
    with pytest.raises(ValueError, match="phase: needs one number, or one for each of 1"):
        Canceller(0.1, phase, 0.1)


def test_one_finite_phase_and_one_gain():
    assert Canceller([0.1, 0.2], [0.0, 1.0], 0.1).start(3).cosine.shape == (3, 2)
    with pytest.raises(ValueError, match="phase: needs to be finite"):
        Canceller(0.1, np.nan, 0.1)
    with pytest.raises(ValueError, match="gain: needs one number"):
        Canceller(0.1, 0.0, [0.1, 0.2])
