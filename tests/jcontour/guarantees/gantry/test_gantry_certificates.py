"""Certificates of a twisting gantry: attacks on the nonlinear machine come close, none exceeds."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle
from jcontour.guarantees.disturbed_loop import Box
from jcontour.guarantees.gantry.gantry_certificates import gantry_certificate
from jcontour.motion.references import along
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.motor_coordinates import MotorEncoders, motor_model
from jcontour.plants.gantry.parameters import thesis_gantry
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import Sensed
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import contour_error

DT = 1e-3


class Turning:
    """A tenth of a second of a circle at 0.1 m/s, the head at the middle of the beam."""

    def __init__(self):
        parameters = thesis_gantry()
        self.gantry, self.sensors = Gantry(parameters, DT), MotorEncoders(parameters)
        model = motor_model(parameters, 0.0, DT)
        self.controller = ContouringLQ(model, LQWeights(1e8, 1e9, 1.0), 5)
        self.reference = along(circle(0.04), 1e-4 * np.arange(100), DT, 5, at_rest=False)

    def certified(self, amperes, noise=0.0):
        box = Box.of(amperes, noise, inputs=3, measured=6)
        return gantry_certificate(self.gantry, self.sensors, self.controller, self.reference, box)

    def error(self, disturbed):
        run = simulate(disturbed, self.controller, self.reference)
        return np.linalg.norm(np.asarray(contour_error(run.output, self.reference)), axis=1)


@pytest.fixture(scope="module")
def turning():
    return Turning()


@pytest.mark.slow
def test_attacks_and_random_forces_stay_below_and_come_close(turning):
    found = turning.certified(0.5)
    plant = Sensed(turning.gantry, turning.sensors)
    attacked = np.array([turning.error(attack.on(plant)) for attack in found.whole.attacks()])
    assert np.all(attacked <= found.whole.bound)
    assert attacked[:, found.whole.worst].max() > 0.96 * found.whole.largest
    assert 0 < found.remainder.max() < 0.05 * found.whole.largest
    random = np.random.default_rng(6)
    for _ in range(3):
        force = 0.5 * np.repeat(np.sign(random.standard_normal((20, 3))), 5, axis=0)
        assert np.all(
            turning.error(Disturbed(plant, force=jnp.asarray(force))) <= found.whole.bound
        )


@pytest.mark.slow
def test_the_remainder_grows_with_the_square_of_the_box(turning):
    small, large = (turning.certified(amperes).remainder.max() for amperes in (0.5, 1.0))
    assert 3.8 < large / small < 6.0


@pytest.mark.slow
def test_a_remainder_that_does_not_close_is_told(turning):
    with pytest.raises(ValueError, match="box: .* not close"):
        turning.certified(2000.0)
