"""Speeds by difference: the wrapped controller sees what encoders with speeds would show."""

import numpy as np

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plants.encoders import Encoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3


def reference(steps=40):
    path = line([0.0, 0.0], [3e-3, 4e-3])
    return along(path, 1e-4 * np.arange(steps), DT, preview=1, at_rest=False)


def test_it_is_the_cascade_on_differences_by_hand(two_axes):
    gains = CascadeGains(30.0, 5.0, 0.02, 0.5)
    controller = SpeedByDifference(Cascade(gains, motors(2), DT), Sensors([0, 1]), DT)
    run = simulate(Encoders(two_axes), controller, reference())
    position = np.asarray(reference().position)
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
    memory = controller.initial_memory(reference())
    np.testing.assert_allclose(memory.position, [-6e-5, -8e-5], rtol=1e-12)
    assert controller.preview == 1
    assert not np.any(np.asarray(memory.inner))
