"""Inverse feedforward against the error filter of Alter & Tsao, superposition and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import InverseFeedforward
from jcontour.controllers.feedforward.l1 import l1_optimum
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.tuned_inverse import OptimalInverse, optimal_filter
from jcontour.controllers.wrappers.speed_by_difference import SpeedByDifference
from jcontour.geometry.contours import circle
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transfer_functions import transfer_function
from jcontour.motion.references import along, from_samples
from jcontour.plants.linear_motor_drive import linear_motor_drive
from jcontour.plants.wrappers.encoders import Encoders
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
    "name",
    [(2, 5, 1), *(pytest.param(name, marks=pytest.mark.slow) for name in [*FOLLOWING][:3])],
)
@pytest.mark.parametrize(
    "gains",
    [(60.0, 150.0, 0.03), pytest.param((20.0, 400.0, 0.1, 1.0, 0.3), marks=pytest.mark.slow)],
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_run_in_motion_is_followed_from_the_start(drive):
    """Two axes on a circle: what is left is the preview that had no time to act."""
    axes = [transfer_function(drive)] * 2
    A, B, C = (np.kron(np.eye(2), np.asarray(m)) for m in (drive.A, drive.B, drive.C))
    machine = LinearPlant(A, B, C, drive.dt)
    ahead = filter_of([OptimalInverse(axis, ModelFollowing(0, 4, 2)) for axis in axes])
    controller = InverseFeedforward(feedback(drive.dt, 2), ahead, Encoders(machine))
    path = circle(20e-3)
    arc = 0.2 * drive.dt * np.arange(800)
    reference = along(path, arc, drive.dt, controller.preview, at_rest=False)
    run = simulate(Encoders(machine), controller, reference)
    away = np.asarray(run.output) - np.asarray(reference.position)[: reference.steps]
    error = np.linalg.norm(away, axis=1)
    assert error.max() < 2e-5 and error[600:].max() < 2e-7


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
