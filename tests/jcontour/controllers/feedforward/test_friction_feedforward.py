"""Friction feedforward against the friction that it cancels, differences and bad input."""

import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.motion.references import from_samples
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3
GAINS = CascadeGains(20.0, [3.0, 2.0], 0.05)


@pytest.fixture(scope="module")
def reference():
    """There, a rest and back; the second axis half as far and the other way round."""
    there = np.cumsum(np.concatenate([[0.0], np.full(30, 1e-4), np.zeros(20), -np.ones(30) * 1e-4]))
    path = np.stack([there, -there / 2], axis=1)
    along = np.tile([1.0, 0.0], (len(path), 1))
    return from_samples(path, along, DT, preview=1, in_motion=False, tolerance=1.0)


def test_it_is_a_step_against_every_direction(reference, two_axes):
    cascade = Cascade(GAINS, motors(2), DT)
    plan = eqx.filter_jit(FrictionFeedforward(cascade, [0.5, 0.2]).prepare)(reference)
    signs = np.concatenate([np.ones(30), np.zeros(20), -np.ones(30)])
    wanted = np.stack([0.5 * signs, -0.2 * signs], axis=1)
    np.testing.assert_array_equal(plan.friction, wanted)
    # one number stands for all axes
    one = eqx.filter_jit(FrictionFeedforward(cascade, 0.5).prepare)(reference)
    np.testing.assert_array_equal(np.asarray(one.friction)[:, 1], -0.5 * signs)


def test_it_is_the_cascade_s_own_term_outside(reference, two_axes):
    """Without an inverse between them both are the same."""
    plant = _read(two_axes)
    inside = CascadeGains(20.0, [3.0, 2.0], 0.05, coulomb=np.array([0.5, 0.2]))
    wanted = jax.device_get(simulate(plant, Cascade(inside, motors(2), DT, 1.0), reference))
    outside = FrictionFeedforward(Cascade(GAINS, motors(2), DT, 1.0), [0.5, 0.2], 1.0)
    found = jax.device_get(simulate(plant, outside, reference))
    free = np.all(np.abs(wanted.control) < 1.0, axis=1)
    assert free[:20].all()
    np.testing.assert_allclose(found.control[:20], wanted.control[:20], atol=1e-12)
    np.testing.assert_allclose(found.output[:20], wanted.output[:20], atol=1e-15)


def test_the_whole_control_stays_within_its_limit(reference, two_axes):
    loops = Cascade(GAINS, motors(2), DT)
    run = simulate(_read(two_axes), FrictionFeedforward(loops, 0.5, [0.3, 0.2]), reference)
    np.testing.assert_allclose(np.abs(run.control).max(axis=0), [0.3, 0.2])


@pytest.mark.parametrize("coulomb", [-0.1, np.nan, [0.1, np.inf]])
def test_bad_gains(coulomb):
    with pytest.raises(ValueError, match="coulomb: needs to be finite and at least zero"):
        FrictionFeedforward(Cascade(GAINS, motors(2), DT), coulomb)


def test_bad_limit():
    with pytest.raises(ValueError, match="limit"):
        FrictionFeedforward(Cascade(GAINS, motors(2), DT), 0.1, 0.0)


def _read(plant):
    return FineEncoders(Encoders(plant), Sensors(range(2)))
