import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import PositionLoop
from jcontour.linear.continuous_axes import position_axis, sampled_machine, speed_axis
from jcontour.motion.references import from_samples
from jcontour.plants.encoders import Encoders
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate

DT, STEPS = 1e-3, 400
TANGENTS = np.tile([1.0, 0.0], (STEPS + 1, 1))


def ramp(speed):
    """From rest at a constant speed of both axes [m/s]."""
    positions = speed * DT * np.arange(STEPS + 1)[:, None] * np.ones(2)
    return from_samples(positions, TANGENTS, DT, 1, in_motion=False)


def run(axis, speed, **gains):
    plant = Encoders(sampled_machine([axis, axis], DT)[0])
    loop = PositionLoop(sensors=Sensors((0, 1)), dt=DT, **gains)
    reference = ramp(speed)
    return np.asarray(reference.position)[:STEPS] - simulate(plant, loop, reference).output


def test_without_feedforward_a_ramp_lags_by_the_speed_over_the_gain():
    """v = K_v e in steady motion; of the velocity's feedforward none is left but that of e."""
    lag = run(speed_axis(0.02, 2e-3, 0.0), 0.01, position=40.0, viscous=50.0, inertia=0.0)
    assert abs(lag[-1, 0]) < 1e-3 * 0.01 / 40 + 1e-5  # fed: only the start is left
    slower = run(speed_axis(0.02 / 1.1, 2e-3, 0.0), 0.01, position=40.0, viscous=50.0, inertia=0.0)
    assert slower[-1, 0] == pytest.approx(0.1 * 0.01 / 40, rel=2e-2)


def test_a_drive_that_takes_a_position_is_given_the_level():
    still = run(
        position_axis(2.0, 5e-3, 0.0), 0.01, position=0.0, viscous=0.0, inertia=0.0, level=0.5
    )
    assert still[-1, 0] == pytest.approx(0.01 * (5e-3 + 0.5e-3), rel=0.15)  # the drive's own lag
    fed = run(
        position_axis(2.0, 5e-3, 0.0), 0.01, position=0.0, viscous=2.5e-3, inertia=0.0, level=0.5
    )
    assert abs(fed[-1, 0]) < 0.2 * still[-1, 0]


def test_gains_are_finite_and_not_negative():
    with pytest.raises(ValueError, match="position"):
        PositionLoop(-1.0, 1.0, 0.0, Sensors((0,)), DT)
