from functools import cache

import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.adapters import OfMotors
from jcontour.geometry.contours import circle
from jcontour.motion.references import along, from_samples
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import prepared

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
    found = prepared(OfMotors(cascade, both_drives()), reference)
    for name in ("position", "velocity", "control"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(wanted, name), rtol=1e-12, atol=1e-13
        )
