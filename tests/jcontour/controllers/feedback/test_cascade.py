from functools import cache

import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains, PositionLoop
from jcontour.geometry.contours import line
from jcontour.linear.continuous_axes import position_axis, sampled_machine, speed_axis
from jcontour.motion.point_to_point import PointToPoint, thesis_task_b
from jcontour.motion.references import from_samples, in_time
from jcontour.plants.actuation import Saturated
from jcontour.plants.encoders import Encoders
from jcontour.plants.flexible_axis.axis import AxisParameters, FlexibleAxis, thesis_axis
from jcontour.plants.friction import Friction
from jcontour.plants.xy_table import xy_table
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import prepared, simulate


# encoders on the loads, resolvers on the motors
@cache
def table_sensors():
    return Sensors((2, 6), (1, 5), 0.7958e-3)


def step_reference(target, dt, steps):
    """From rest at the origin straight to a point (m,) [m]."""
    samples = np.tile(np.asarray(target, float), (steps + 1, 1))
    samples[0] = 0.0
    return from_samples(
        samples, np.tile(np.eye(len(target))[0], (steps + 1, 1)), dt, 1, in_motion=False
    )


# section 3.4.2
@cache
def thesis_gains():
    return CascadeGains(30.0, 55.67, 0.04)


def thesis_run(task, gains=None):
    gains = thesis_gains() if gains is None else gains
    return simulate(FlexibleAxis(thesis_axis(), 1e-3), Cascade(gains, motors(1), 1e-3), task)


def test_feedforward_is_what_the_motion_needs_of_a_rigid_motor():
    """Under the exact inverse of mass and drag only sampling is left for the loop."""
    none, rigid = Friction(0.0, 0.0, 1.0, 200.0), 1e7
    axis = FlexibleAxis(
        AxisParameters(20.0, 20.0, rigid, 2e3, 80.0, none, [0.0], [0.0], 1.0), 1e-3, substeps=40
    )
    task = in_time(line([0.0], [0.1]), PointToPoint(0.1, 0.2, 2.0, 40.0), 0.8, 1e-3)
    errors, shares = [], []
    for gains in (
        CascadeGains(30.0, 55.67, 0.04),
        CascadeGains(30.0, 55.67, 0.04, 1.0, inertia=0.5, viscous=2.5),
    ):
        controller = Cascade(gains, motors(1), 1e-3)
        run = simulate(axis, controller, task)
        errors.append(np.abs(np.asarray(run.output) - np.asarray(task.position)[:-1]).max())
        shares.append(np.abs(np.subtract(run.control, prepared(controller, task).control)).max())
    assert errors[1] < 0.02 * errors[0] and shares[1] < 0.05 * np.abs(run.control).max()


def test_friction_feedforward_halves_the_error_of_the_cosine():
    """Against the true axis: what velocity and acceleration feedforward leave is the reversal."""
    fed = [
        CascadeGains(30.0, 55.67, 0.04, 1.0, 0.504),
        CascadeGains(30.0, 55.67, 0.04, 1.0, 0.504, 250.9 / 79.33, 58.4 / 79.33),
    ]
    runs = [thesis_run(thesis_task_b(), gains) for gains in fed]
    wanted = np.asarray(thesis_task_b().position)[:-1]
    errors = [np.abs(np.asarray(run.output) - wanted).mean() for run in runs]
    assert errors[1] < 0.5 * errors[0]


def test_clamped_integrator_overshoots_less_than_an_unlimited_one_on_a_saturated_machine():
    dt, target = 1e-3, np.array([0.02, 0.03])
    plant, reference = xy_table(dt), step_reference(target, dt, 1500)
    gains = CascadeGains(25.0, 10.0, 0.05)
    limited = simulate(plant, Cascade(gains, table_sensors(), dt, 0.5), reference)
    assert np.abs(limited.control).max() <= 0.5 and np.abs(limited.memory).max() <= 0.5
    assert (np.abs(np.asarray(limited.control)) == 0.5).any()

    windup = simulate(
        Saturated(plant, np.array([0.5, 0.5])), Cascade(gains, table_sensors(), dt), reference
    )
    overshoot = [
        float((np.asarray(run.output).max(axis=0) - target).max()) for run in (limited, windup)
    ]
    assert overshoot[0] < 0.5 * overshoot[1]
    np.testing.assert_allclose(limited.output[-1], target, atol=1e-6)


def test_velocity_feedforward_removes_the_lag_of_a_ramp():
    dt, speed = 1e-3, 0.05
    position = speed * dt * np.arange(1501)[:, None] * np.array([0.6, 0.8])
    reference = from_samples(position, np.broadcast_to([0.6, 0.8], position.shape), dt, 1)
    lags = []
    for share in (0.0, 1.0):
        controller = Cascade(CascadeGains(25.0, 10.0, 0.05, share), table_sensors(), dt, 0.5)
        run = simulate(xy_table(dt), controller, reference)
        lags.append(np.linalg.norm(np.asarray(run.output)[-1] - position[1499]))
    assert lags[0] == pytest.approx(speed / 25.0, rel=3e-2) and lags[1] < 0.06 * lags[0]


@pytest.mark.parametrize(
    ("gains", "name"),
    [
        ({"position": -1.0}, "position"),
        ({"integral_time": 0.0}, "integral_time"),
        ({"coulomb": -0.1}, "coulomb"),
    ],
)
def test_bad_gains_are_named(gains, name):
    with pytest.raises(ValueError, match=name):
        CascadeGains(**{"position": 1.0, "velocity": 1.0, "integral_time": 1.0, **gains})


def test_bad_sensors_and_limits_are_named():
    gains = CascadeGains(1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="sensors: the velocity loop"):
        Cascade(gains, Sensors((0,)), 1e-3)
    with pytest.raises(ValueError, match="limit"):
        Cascade(gains, table_sensors(), 1e-3, 0.0)


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
