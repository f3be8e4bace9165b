"""Inverse feedforward against the error filter of Alter & Tsao, superposition and differences.

Friction feedforward against the friction that it cancels, differences and bad input.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import (
    FrictionFeedforward,
    InverseFeedforward,
)
from jcontour.controllers.feedforward.l1 import l1_optimum
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.tuned_inverse import OptimalInverse, optimal_filter
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.linear.transfer_functions import transfer_function
from jcontour.motion.references import from_samples
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.plants.linear_machines import linear_motor_drive
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate

FOLLOWING = {name: ModelFollowing(*name) for name in ((0, 1, 2), (1, 3, 2), (0, 6, 0), (2, 5, 1))}


@pytest.fixture(scope="module")
def drive():
    return linear_motor_drive()


def feedback(dt, axes=1, gains=(60.0, 150.0, 0.03), limit=np.inf):
    loops = Cascade(CascadeGains(*gains), motors(axes), dt, limit)
    return SpeedByDifference(loops, Sensors(range(axes)), dt)


def filter_of(inverses):
    return jax.jit(lambda *numbers: optimal_filter(inverses, *numbers))(0.25, 1.0)


def tracked(drive, following, wrapped, trajectory):
    ahead = filter_of([OptimalInverse(transfer_function(drive), following)])
    controller = InverseFeedforward(wrapped, ahead, Encoders(drive))
    samples = np.concatenate([np.asarray(trajectory), np.zeros(controller.preview)])[:, None]
    reference = from_samples(
        samples, np.ones_like(samples), drive.dt, controller.preview, in_motion=False
    )
    return controller, reference


@pytest.mark.parametrize(
    ("name", "gains"),
    [((2, 5, 1), (60.0, 150.0, 0.03)), ((0, 6, 0), (20.0, 400.0, 0.1, 1.0, 0.3))],
)
def test_the_error_is_the_filter_s_whatever_the_feedback(alter_tsao, drive, name, gains):
    following, trajectory = FOLLOWING[name], alter_tsao["trajectory_m"]
    controller, reference = tracked(drive, following, feedback(drive.dt, gains=gains), trajectory)
    run = simulate(Encoders(drive), controller, reference)
    zeros = np.array([0.0, transfer_function(drive).zeros[0].real])
    taps, _ = following.tracking_error(l1_optimum(following.matching(zeros)))
    ahead = following.preview
    padded = np.concatenate([np.zeros(len(taps)), trajectory, np.zeros(ahead)])
    wanted = np.convolve(padded, taps)[len(taps) + ahead :][: len(trajectory)]
    error = np.asarray(reference.position)[: len(trajectory), 0] - np.asarray(run.output)[:, 0]
    np.testing.assert_allclose(error, wanted, atol=1e-11)


def test_a_disturbed_start_is_the_feedback_s_alone(alter_tsao, drive):
    trajectory, wrapped = alter_tsao["trajectory_m"], feedback(drive.dt)
    controller, reference = tracked(drive, FOLLOWING[1, 3, 2], wrapped, trajectory)
    start = jnp.array([1e-4, 2e-3, 0.1])
    moved = simulate(Encoders(drive), controller, reference, start)
    straight = simulate(Encoders(drive), controller, reference)
    still = from_samples(
        np.zeros_like(reference.position),
        np.ones_like(reference.position),
        drive.dt,
        controller.preview,
        reference.contour,
        False,
        tolerance=1.0,
    )
    alone = simulate(Encoders(drive), wrapped, still, start)
    np.testing.assert_allclose(moved.output - straight.output, alone.output, atol=1e-12)


def test_the_control_stays_within_its_limit(alter_tsao, drive):
    controller, reference = tracked(
        drive, FOLLOWING[1, 3, 2], feedback(drive.dt), alter_tsao["trajectory_m"]
    )
    free = simulate(Encoders(drive), controller, reference)
    most = 0.5 * float(np.abs(free.control).max())
    clipped = InverseFeedforward(controller.controller, controller.ahead, controller.machine, most)
    run = simulate(Encoders(drive), clipped, reference)
    assert float(np.abs(run.control).max()) == pytest.approx(most)


def test_bad_input(alter_tsao, drive):
    controller, reference = tracked(
        drive, FOLLOWING[0, 6, 0], feedback(drive.dt), alter_tsao["trajectory_m"]
    )
    assert controller.preview == 6
    short = from_samples(
        reference.position, np.ones_like(reference.position), drive.dt, 5, in_motion=False
    )
    with pytest.raises(ValueError, match="looks 6 samples ahead"):
        controller.prepare(short)
    with pytest.raises(ValueError, match="limit"):
        InverseFeedforward(controller.controller, controller.ahead, controller.machine, 0.0)


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


def test_a_reversal_takes_its_samples_around_the_planned_one(two_axes):
    """From rest to the friction in half of them; no sample changes by more than their share."""
    steps = np.concatenate([np.zeros(10), np.full(20, 1e-4), np.full(20, -1e-4), np.zeros(10)])
    path = np.concatenate([[0.0], np.cumsum(steps)])[:, None]
    reference = from_samples(path, np.ones((61, 1)), DT, preview=5, in_motion=False)
    loops = Cascade(GAINS, motors(1), DT)
    friction = FrictionFeedforward(loops, 0.5, ahead=4, turning=8).prepare(reference).friction
    # sample k moves under the control of sample k: 10, 30 and 50 are in the middle of a ramp
    wanted = np.interp(np.arange(56), [5, 9, 25, 33, 45, 49], [0, 0.5, 0.5, -0.5, -0.5, 0])
    np.testing.assert_allclose(np.asarray(friction)[:, 0], wanted, atol=1e-12)


def test_it_is_the_cascade_s_own_term_outside(reference, two_axes):
    """Without an inverse between them both are the same."""
    plant = _read(two_axes)
    inside = CascadeGains(20.0, [3.0, 2.0], 0.05, coulomb=np.array([0.5, 0.2]))
    wanted = jax.device_get(simulate(plant, Cascade(inside, motors(2), DT, 1.0), reference))
    outside = FrictionFeedforward(Cascade(GAINS, motors(2), DT, 1.0), [0.5, 0.2], 1.0)
    actual = jax.device_get(simulate(plant, outside, reference))
    free = np.all(np.abs(wanted.control) < 1.0, axis=1)
    assert free[:20].all()
    np.testing.assert_allclose(actual.control[:20], wanted.control[:20], atol=1e-12)
    np.testing.assert_allclose(actual.output[:20], wanted.output[:20], atol=1e-15)


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
