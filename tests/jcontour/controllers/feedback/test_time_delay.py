"""Time-delay control against reference numbers and on a servo."""

import json
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.observers.disturbance_observer import Motion, Past, TimeDelayControl
from jcontour.geometry.contours import line
from jcontour.motion.references import from_samples
from jcontour.plant import Plant
from jcontour.plants.actuation import Saturated
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate

DATA = Path(__file__).parents[3] / "data" / "adaptive" / "companions.json"
COMPANIONS = json.loads(DATA.read_text())
PERIOD, LOST = 1e-3, 1e3
ROWS = [(0.0, row) for row in COMPANIONS["tdc_double_integrator"]]
ROWS += [(1e4, row) for row in COMPANIONS["tdc_magnetic_bearing_k_1e4"]]


class Bearing(Plant):
    """acc = kx x + b u + load sin(4 pi t), held over the step; x before v as in the numbers."""

    spring: float
    gain: float
    load: float = 5.0
    dt: float = PERIOD

    def initial_state(self, position, increment):
        return position, increment / self.dt, jnp.zeros(())

    def step(self, state, control):
        x, v, k = state
        force = self.load * jnp.sin(4 * jnp.pi * k * self.dt)
        acceleration = self.spring * x + self.gain * control + force
        return (
            x + self.dt * v + self.dt**2 * acceleration / 2,
            v + self.dt * acceleration,
            k + 1,
        )

    def output(self, state):
        return state[0]

    def measure(self, state):
        return state[:2]


def held_at(distance, steps):
    wanted, ahead = np.full((steps + 1, 1), distance), np.ones((steps + 1, 1))
    contour = line([0.0], [2 * distance])
    return from_samples(wanted, ahead, PERIOD, 1, contour, in_motion=False)


@pytest.mark.parametrize(("spring", "row"), ROWS)
def test_what_is_left_is_that_of_the_reference(spring, row):
    reference = held_at(0.01, 2000)
    controller = TimeDelayControl(400.0, 40.0, 1.0, motors(1), PERIOD)
    plant = Bearing(spring, row["b_over_bhat"])
    rest = (np.zeros(1), np.zeros(1), np.zeros(()))
    run = simulate(plant, controller, reference, rest)
    error = np.abs(0.01 - np.asarray(run.output)[:, 0])
    if row["tail_max_err_m"] == "inf":
        assert not np.all(error < LOST)
    else:
        np.testing.assert_allclose(error[-200:].max(), float(row["tail_max_err_m"]), rtol=1e-8)


def test_a_moving_reference_is_followed_with_its_acceleration():
    """On the exact double integrator nothing is left but the sampling."""
    steps, k = 800, np.arange(802)
    path = 0.01 * (1 - np.cos(2 * np.pi * k / 400))[:, None]
    reference = from_samples(path, np.ones_like(path), PERIOD, 2, in_motion=False)
    controller = TimeDelayControl(400.0, 40.0, 1.0, motors(1), PERIOD)
    run = simulate(Bearing(0.0, 1.0), controller, reference)
    late = np.abs(np.asarray(run.output)[400:, 0] - path[400:steps, 0])
    assert late.max() < 3e-4


def overshoot_of_a_limited_mass(distance, limit, steps):
    """Greatest x - distance of x'' = clip(900 (distance - x) - 60 x'), held over the samples."""
    x, v, greatest = 0.0, 0.0, 0.0
    for _ in range(steps):
        acceleration = np.clip(900 * (distance - x) - 60 * v, -limit, limit)
        x += PERIOD * v + PERIOD**2 * acceleration / 2
        v += PERIOD * acceleration
        greatest = max(greatest, x - distance)
    return greatest


@pytest.mark.parametrize("limit", [10.0, 5.0, 1.0])
def test_a_step_beyond_the_limit_does_not_wind_up(limit):
    """With bhat = 2 b it overshoots as the same poles on a limited mass do, and settles."""
    steps, distance = 4000, 0.05
    controller = TimeDelayControl(900.0, 60.0, 2.0, motors(1), PERIOD, limit)
    plant = Saturated(Bearing(0.0, 1.0, load=0.0), jnp.array([limit]))
    rest = (jnp.zeros(1), jnp.zeros(1), jnp.zeros(()))
    run = simulate(plant, controller, held_at(distance, steps), rest)
    output, control = np.asarray(run.output)[:, 0], np.asarray(run.control)[:, 0]
    wanted = overshoot_of_a_limited_mass(distance, limit, steps)
    assert output.max() - distance == pytest.approx(wanted, rel=0.05, abs=1e-9)
    assert np.abs(control).max() == limit
    np.testing.assert_allclose(output[-100:], distance, rtol=0, atol=1e-9)


def test_a_limit_for_each_axis_bounds_control_and_memory():
    limit = np.array([0.5, 2.0])
    controller = TimeDelayControl(400.0, 40.0, 1.0, motors(2), PERIOD, limit)
    target = Motion(*map(placed, np.array([[0.1, -0.1], [0.0, 0.0], [0.0, 0.0]])))
    past = Past(*map(placed, np.zeros((2, 2))))
    step = eqx.filter_jit(controller.step)
    memory, control = step(past, target, (np.zeros(2), np.zeros(2)))
    np.testing.assert_array_equal(control, [0.5, -2.0])
    np.testing.assert_array_equal(memory.control, [0.5, -2.0])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((-1.0, 1.0, 1.0, motors(1), PERIOD), "stiffness: needs to be finite"),
        ((1.0, 1.0, 0.0, motors(1), PERIOD), "input_gain: needs to be above zero"),
        ((1.0, 1.0, 1.0, motors(1), PERIOD, 0.0), "limit: needs to be above zero"),
        ((1.0, 1.0, 1.0, motors(1), PERIOD, np.nan), "limit: needs to be above zero"),
        ((1.0, 1.0, 1.0, Sensors((0,)), PERIOD), "sensors: time-delay control needs speeds"),
    ],
)
def test_bad_input(arguments, says):
    with pytest.raises(ValueError, match=says):
        TimeDelayControl(*arguments)
