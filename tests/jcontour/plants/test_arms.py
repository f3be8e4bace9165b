"""The three-link manipulator against reference numbers, rotations of SciPy and differences."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jcontour.plants.arms import LVDT_QUANTUM, SERVO_GAIN, SERVO_POLE, ThreeLink, manipulator_path
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.linear_machines import servo_axes

DATA = Path(__file__).parents[2] / "data" / "adaptive" / "kinematics.json"
REFERENCE = json.loads(DATA.read_text())
ROWS = REFERENCE["kinematics"]["rows"]


legs_of, balls_of = jax.jit(ThreeLink.legs), jax.jit(ThreeLink.balls)


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
    legs = np.asarray(legs_of(ThreeLink(), pose_of(row)))
    np.testing.assert_allclose(1e3 * legs, row["lengths_mm"], rtol=1e-13)


def test_other_sizes_and_a_batch():
    random = np.random.default_rng(0)
    manipulator = ThreeLink(0.15, 0.18, shortest=0.1, longest=0.8)
    poses = np.stack([random.uniform(0.3, 0.5, 40), *random.uniform(-0.35, 0.35, (2, 40))], axis=-1)
    balls = manipulator.balls(poses)
    psi = np.deg2rad([0, 120, 240])
    pins = 0.15 * np.stack([np.cos(psi), np.sin(psi), 0 * psi], axis=-1)
    for pose, found in zip(poses, balls, strict=True):
        np.testing.assert_allclose(found, balls_by_scipy(pose, 0.18), atol=1e-15)
    lengths = np.linalg.norm(np.asarray(balls) - pins, axis=-1)
    np.testing.assert_allclose(manipulator.legs(poses), lengths, atol=1e-15)


def test_the_path_is_that_of_the_reference():
    times = 3e-3 * np.arange(2001)
    legs = np.asarray(legs_of(ThreeLink(), manipulator_path(times)))
    moved = 1e3 * (legs[:, 0] - legs[0, 0])
    wanted = REFERENCE["link0_samples_3ms_every_100"]
    np.testing.assert_allclose(moved[::100], wanted, rtol=1e-11, atol=1e-11)


def test_the_path_rests_before_and_after():
    inside, outside = manipulator_path(np.array([0.0, 6.0])), manipulator_path(np.array([-1, 9.0]))
    np.testing.assert_array_equal(inside, outside)


@pytest.mark.parametrize("pose", [[0.4, 0.0, 0.0], [0.42, 0.1, -0.2]])
def test_derivatives_of_the_legs(pose):
    manipulator, pose = ThreeLink(), np.array(pose)
    J = jax.jacfwd(manipulator.legs)(jnp.asarray(pose))
    steps = 1e-6 * np.eye(3)
    columns = [(manipulator.legs(pose + h) - manipulator.legs(pose - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(J, np.stack(columns, axis=-1), atol=1e-9)


@pytest.mark.parametrize("pose", [[0.9, 0.0, 0.0], [0.1, 0.0, 0.0], [np.nan, 0.0, 0.0]])
def test_out_of_reach(pose):
    with pytest.raises(ValueError, match="out of reach"):
        ThreeLink().legs(np.array(pose))


@pytest.mark.parametrize("sizes", [(0.0, 0.1), (0.2, -0.1), (0.2, np.inf)])
def test_bad_sizes(sizes):
    with pytest.raises(ValueError, match="radius: needs to be above zero"):
        ThreeLink(*sizes)


def test_an_empty_stroke():
    with pytest.raises(ValueError, match="shortest"):
        ThreeLink(shortest=0.5, longest=0.4)


def test_servos_move_steadily_and_are_measured_in_quanta():
    plant = Quantised(Encoders(servo_axes(np.full(3, SERVO_GAIN), SERVO_POLE, 3e-3)), LVDT_QUANTUM)
    position, increment = jnp.array([1e-2, 0.0, -2e-2]), jnp.array([1e-5, 0.0, 2e-5])
    state = plant.initial_state(position, increment)
    np.testing.assert_allclose(plant.output(state), position, atol=1e-15)
    counts = np.asarray(plant.measure(state)) / LVDT_QUANTUM
    np.testing.assert_array_equal(np.round(counts), [233, 0, -465])
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
