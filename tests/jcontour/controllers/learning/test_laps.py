"""Laps of a closed loop: the shifted reference, noise by the lap, and gradients through laps.

The P-type law against reference numbers and against its own filter by SciPy.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import convolve1d

from jcontour._arrays import placed
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.controllers.learning.laps import (
    Lap,
    Learned,
    PType,
    diverged_lap,
    laps_of,
    learn,
    paying_laps,
    smoothed,
)
from jcontour.plants.actuation import Disturbed
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

STATE = Sensors((0, 2), (1, 3))  # of two `servo_axes`
DT = 5e-3  # [s], of the small loop
COMPANIONS = numbers_of("adaptive/companions")


class Ahead(Cascade):
    """A cascade that is fed the samples of the preview too."""

    def prepare(self, reference):
        return reference.position


def test_a_correction_shifts_the_reference_and_what_is_seen_beyond_its_end(small_loop):
    _, cascade, reference = small_loop()
    shift = 1e-3 * np.random.default_rng(0).standard_normal((reference.steps, 2))
    seen = Learned(Ahead(cascade.gains, STATE, DT), jnp.asarray(shift)).prepare(reference)
    whole = np.concatenate([shift, shift[-1:]])
    np.testing.assert_allclose(seen, reference.position + whole, rtol=0, atol=1e-17)


def test_a_correction_of_another_lap_is_refused(small_loop):
    _, controller, reference = small_loop()
    for shape in ((reference.steps + 1, 2), (reference.steps, 1)):
        with pytest.raises(ValueError, match=r"correction: needs the shape \(120, 2\) of the lap"):
            Learned(controller, placed(np.zeros(shape))).prepare(reference)


@pytest.mark.slow
def test_laps_by_hand(small_loop, positions):
    """Three laps written out, the noise of each its own."""
    plant, controller, reference = small_loop()
    noise = jnp.asarray(1e-5 * np.random.default_rng(1).standard_normal((3, 120, 4)))
    law = PType(gain=0.4, lead=3, smoothing=2)
    run = laps_of(lambda lap: Disturbed(plant, noise=noise[lap]), controller, reference, positions)
    actual, last = learn(run, law, 3, jnp.zeros((120, 2)))
    correction = jnp.zeros((120, 2))
    for lap in range(3):
        noisy = Disturbed(plant, noise=noise[lap])
        rollout = simulate(noisy, Learned(controller, correction), reference)
        error = reference.position[:120] - rollout.measurement[:, jnp.array([0, 2])]
        np.testing.assert_allclose(actual.error[lap], error, rtol=0, atol=1e-15)
        np.testing.assert_allclose(actual.output[lap], rollout.output, rtol=0, atol=1e-15)
        np.testing.assert_allclose(actual.correction[lap], correction, rtol=0, atol=1e-15)
        correction = law.update(correction, error)
    np.testing.assert_allclose(last, correction, rtol=0, atol=1e-15)


def test_no_laps_are_refused(small_loop, positions):
    plant, controller, reference = small_loop()
    run = laps_of(lambda lap: plant, controller, reference, positions)
    with pytest.raises(ValueError, match="laps: needs at least one, received 0"):
        learn(run, PType(0.5), 0, placed(np.zeros((120, 2))))


@pytest.mark.parametrize(
    ("errors", "lap"),
    [
        ([1.0, 0.5, 0.2], None),
        ([1.0, 2.0, 2.1], 3),
        ([1.0, np.nan, 0.1], 2),
        ([np.inf, 1.0], 1),
        ([1.0], None),
        ([0.0, 0.0], None),
        ([0.0, 1e-12], None),  # rounding
        ([1e-13, 1e-12], None),
        ([0.0, 1e-6], 2),
        ([np.nan, np.nan], 1),
    ],
)
def test_the_lap_at_which_learning_diverges(errors, lap):
    assert diverged_lap(errors) == lap


@pytest.mark.parametrize(
    ("errors", "lap"),
    [
        ([1.0], 1),
        ([3.0, 2.0, 1.0], 3),
        ([1.0, 5.0], 1),
        ([2, 1.04, 1.0], 2),
        ([3.0, 1.0, np.inf, np.nan], 2),
        ([np.nan, np.nan], None),
        ([np.inf], None),
    ],
)
def test_the_lap_after_which_it_no_longer_pays(errors, lap):
    assert paying_laps(errors) == lap


@pytest.mark.parametrize("count", [diverged_lap, paying_laps])
@pytest.mark.parametrize("errors", [[], [[1.0, 2.0]], 1.0])
def test_errors_that_are_not_one_per_lap_are_refused(count, errors):
    with pytest.raises(ValueError, match="errors: need one number per lap"):
        count(errors)


def first_order(u, lap):
    """The plant y(k+1) = 0.5 y(k) + 0.5 u(k) of the reference numbers."""
    wanted = jnp.sin(2 * jnp.pi * jnp.arange(1.0, 51.0) / 50)[:, None]
    _, y = jax.lax.scan(lambda y, u: ((y + u) / 2,) * 2, jnp.zeros(1), u)
    return Lap(u, wanted - y, y, u)


def trials(gain, laps):
    actual, _ = learn(first_order, PType(gain), laps, placed(np.zeros((50, 1))))
    return np.abs(np.asarray(actual.error)).max(axis=(1, 2))


@pytest.mark.parametrize("gain", ["1.0", "2.0", "3.0"])
def test_trials_are_those_of_the_reference(gain):
    wanted = COMPANIONS["ilc_p_type"][gain]
    np.testing.assert_allclose(trials(float(gain), 12), wanted, rtol=1e-8)


def test_a_gain_that_diverges_is_found_at_its_lap():
    errors = trials(4.2, 20)
    wanted = COMPANIONS["ilc_p_type_divergent_gain_4.2_trial_20"]
    np.testing.assert_allclose(errors[-1], wanted, rtol=1e-8)
    assert diverged_lap(errors) == 2
    assert diverged_lap(COMPANIONS["ilc_p_type"]["3.0"]) == diverged_lap(trials(3.0, 12)) == 3
    assert diverged_lap(trials(1.0, 12)) is None


def test_the_filter_is_a_convolution_with_held_ends():
    signal = np.random.default_rng(0).standard_normal((30, 2))
    wanted = signal
    for _ in range(5):
        wanted = convolve1d(wanted, [0.25, 0.5, 0.25], axis=0, mode="nearest")
    np.testing.assert_allclose(smoothed(placed(signal), 5), wanted, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"gain": -1.0}, "gain: needs to be finite and at least zero"),
        ({"gain": 0.5, "lead": -1}, "lead: needs a whole number"),
        ({"gain": 0.5, "smoothing": 1.5}, "smoothing: needs a whole number"),
    ],
)
def test_bad_input(any_type, arguments, says):
    with pytest.raises(ValueError, match=says):
        PType(**arguments)


def test_a_lead_longer_than_the_lap():
    with pytest.raises(ValueError, match="lead: 9 samples are more than the lap of 5 has"):
        PType(0.5, lead=9).update(*map(placed, np.zeros((2, 5, 1))))
