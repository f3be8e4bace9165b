"""Speeds by difference: the wrapped controller sees what encoders with speeds would show."""

from functools import cache

import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.adapters import OfMotors, SpeedByDifference
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along, from_samples
from jcontour.plants.encoders import Encoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import prepared, simulate

DT = 1e-3


@cache
def both_drives():
    return np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])


# [A s^2/m] moving mass over force constant
@cache
def moving_mass():
    return np.array([40.0, 65.0, 65.0]) / 60


@pytest.fixture(scope="module")
def reference():
    return along(circle(0.05), 1e-4 * np.arange(400), DT, 1, at_rest=False)


@pytest.fixture(scope="module")
def cascade():
    gains = CascadeGains(20.0, 100 * moving_mass(), 0.05, 1.0, moving_mass(), 200 / 60)
    return Cascade(gains, motors(3), DT, 10.0)


def test_every_motor_gets_its_share_of_the_path(reference, cascade):
    """The plan is that of a reference whose third axis is the second once more."""
    position, tangent = (np.asarray(rows) for rows in (reference.position, reference.tangent))
    third = position[:, [0, 1, 1]]
    unit = np.concatenate([tangent, 0 * tangent[:, :1]], axis=1)
    wanted = prepared(cascade, from_samples(third, unit, DT, 1))
    actual = prepared(OfMotors(cascade, both_drives()), reference)
    for name in ("position", "velocity", "control"):
        np.testing.assert_allclose(
            getattr(actual, name), getattr(wanted, name), rtol=1e-12, atol=1e-13
        )


def speed_by_difference_reference(steps=40):
    path = line([0.0, 0.0], [3e-3, 4e-3])
    return along(path, 1e-4 * np.arange(steps), DT, preview=1, at_rest=False)


def test_it_is_the_cascade_on_differences_by_hand(two_axes):
    gains = CascadeGains(30.0, 5.0, 0.02, 0.5)
    controller = SpeedByDifference(Cascade(gains, motors(2), DT), Sensors([0, 1]), DT)
    run = simulate(Encoders(two_axes), controller, speed_by_difference_reference())
    position = np.asarray(speed_by_difference_reference().position)
    before = np.asarray(run.output)
    before = np.concatenate([(position[0] - (position[1] - position[0]))[None], before])
    integral = np.zeros(2)
    for k, control in enumerate(np.asarray(run.control)):
        speed = (before[k + 1] - before[k]) / DT
        wanted = (position[k + 1] - position[k]) / DT
        error = 30.0 * (position[k] - before[k + 1]) + 0.5 * wanted - speed
        integral = integral + 5.0 * DT / 0.02 * error
        np.testing.assert_allclose(control, 5.0 * error + integral, rtol=1e-9, atol=1e-12)


def test_it_enters_at_the_speed_of_the_reference():
    gains = CascadeGains(30.0, 5.0, 0.02)
    controller = SpeedByDifference(Cascade(gains, motors(2), DT), Sensors([0, 1]), DT)
    memory = controller.initial_memory(speed_by_difference_reference())
    np.testing.assert_allclose(memory.position, [-6e-5, -8e-5], rtol=1e-12)
    assert controller.preview == 1
    assert not np.any(np.asarray(memory.inner))
