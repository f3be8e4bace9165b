"""The three-link manipulator against reference numbers, rotations of SciPy and differences."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jcontour.plants.arms import (
    BASE_RADIUS,
    LVDT_QUANTUM,
    PLATFORM_RADIUS,
    SERVO_GAIN,
    SERVO_POLE,
    leg_lengths,
    manipulator_path,
)
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.linear_machines import servo_axes
from tests.reference_data import numbers_of

REFERENCE = numbers_of("adaptive/kinematics")
ROWS = REFERENCE["kinematics"]["rows"]


def pose_of(row):
    tilt = row["beta"] * np.array([np.cos(row["alpha"]), np.sin(row["alpha"])])
    return np.array([1e-3 * row["z"], *tilt])


def balls_by_scipy(pose, h):
    """Balls from rotations about axes, an independent computation."""
    z, x, y = pose
    alpha, beta = np.arctan2(y, x), np.hypot(x, y)
    turn = Rotation.from_euler("z", alpha) * Rotation.from_euler("y", beta)
    turn = turn * Rotation.from_euler("z", -alpha)
    side = h / 2 * (1 - np.cos(beta))
    centre = [-side * np.cos(2 * alpha), side * np.sin(2 * alpha), z]
    psi = np.deg2rad([0, 120, 240])
    return centre + h * turn.apply(np.stack([np.cos(psi), np.sin(psi), 0 * psi], axis=-1))


@pytest.mark.parametrize("row", ROWS)
def test_legs_are_those_of_the_reference(row):
    legs = leg_lengths(pose_of(row)[None])[0]
    np.testing.assert_allclose(1e3 * legs, row["lengths_mm"], rtol=1e-13)


def test_legs_end_where_rotations_about_the_axes_put_the_balls():
    random = np.random.default_rng(0)
    poses = np.stack([random.uniform(0.3, 0.5, 40), *random.uniform(-0.35, 0.35, (2, 40))], axis=-1)
    psi = np.deg2rad([0, 120, 240])
    pins = BASE_RADIUS * np.stack([np.cos(psi), np.sin(psi), 0 * psi], axis=-1)
    for pose, legs in zip(poses, leg_lengths(poses), strict=True):
        balls = balls_by_scipy(pose, PLATFORM_RADIUS)
        np.testing.assert_allclose(legs, np.linalg.norm(balls - pins, axis=-1), atol=1e-15)


def test_the_path_is_that_of_the_reference():
    times = 3e-3 * np.arange(2001)
    legs = leg_lengths(manipulator_path(times))
    moved = 1e3 * (legs[:, 0] - legs[0, 0])
    wanted = REFERENCE["link0_samples_3ms_every_100"]
    np.testing.assert_allclose(moved[::100], wanted, rtol=1e-11, atol=1e-11)


def test_the_path_rests_before_and_after():
    inside, outside = manipulator_path(np.array([0.0, 6.0])), manipulator_path(np.array([-1, 9.0]))
    np.testing.assert_array_equal(inside, outside)


def test_servos_move_steadily_and_are_measured_in_quanta():
    plant = Quantised(Encoders(servo_axes(np.full(3, SERVO_GAIN), SERVO_POLE, 3e-3)), LVDT_QUANTUM)
    position, increment = jnp.array([1e-2, 0.0, -2e-2]), jnp.array([1e-5, 0.0, 2e-5])
    state = plant.initial_state(position, increment)
    np.testing.assert_allclose(plant.output(state), position, atol=1e-15)
    counts = np.asarray(plant.measure(state)) / LVDT_QUANTUM
    np.testing.assert_array_equal(np.round(counts), [233, 0, -465])
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
