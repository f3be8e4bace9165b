"""Cancellation of run-out against reference numbers, and around a cascade."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.learning.repetitive import Canceller, RunoutCancelled
from jcontour.geometry.contours import line
from jcontour.motion.references import from_samples
from jcontour.plants.actuation import Disturbed
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate

STATE = Sensors((0, 2), (1, 3))


@pytest.mark.parametrize("degrees", ["0", "60", "85", "95"])
def test_what_is_left_is_that_of_the_reference(companions, degrees):
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
    np.testing.assert_allclose(left, companions["runout_afc"][degrees], rtol=1e-8)


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
