"""Time-delay control against reference numbers and on a servo."""

from functools import cache

import control
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains, Commanded
from jcontour.controllers.observers.disturbance_observer import (
    DisturbanceObserver,
    Past,
    ReducedObserver,
    TimeDelayControl,
    augmented_model,
    error_matrix,
    thesis_gain,
)
from jcontour.geometry.contours import line
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.linear.transformations import zoh
from jcontour.motion.point_to_point import thesis_task_a
from jcontour.motion.references import from_samples
from jcontour.plant import Plant
from jcontour.plants.actuation import Disturbed, Saturated
from jcontour.plants.encoders import Sensed
from jcontour.plants.flexible_axis.axis import euler_model, thesis_axis, zoh_model
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

DT, B0, W = 1e-3, 2.0, 300.0


@pytest.fixture(scope="module")
def cascade():
    return Cascade(CascadeGains(30.0, 20.0, 0.1), motors(1), DT)


@pytest.fixture(scope="module")
def rigid():
    """The nominal model as a machine."""
    A, B = zoh([[0.0, 1.0], [0.0, 0.0]], [[0.0], [B0]], DT)
    return LinearPlant(A, B, [[1.0, 0.0]], DT)


@pytest.fixture(scope="module")
def task():
    return thesis_task_a()


def observed(cascade, sensors=None, bandwidth=W, input_gain=B0, dt=DT, **options):
    sensors = motors(1) if sensors is None else sensors
    return DisturbanceObserver(cascade, sensors, bandwidth, input_gain, dt, **options)


def nominal():
    """Q of the docstring, by python-control."""
    poles = np.poly(np.exp(DT * np.roots([1.0, np.sqrt(2) * W, W**2])))
    return control.tf(np.sum(poles) / 2 * np.array([1.0, 1.0]), poles, DT)


def test_the_estimate_is_the_disturbance_through_q(cascade, rigid, task):
    """Whatever the loop does: against the response by python-control."""
    force = np.random.default_rng(0).standard_normal(task.steps)
    run = simulate(Disturbed(rigid, placed(force[:, None])), observed(cascade), task)
    estimate = np.asarray(run.memory.first)[:, 0]
    x = np.asarray(run.state[0])[:, 0]
    inverse = float(observed(cascade)._filters()[1])
    wanted = control.forced_response(nominal(), U=force).outputs
    np.testing.assert_allclose(estimate + inverse * x, wanted, rtol=0, atol=1e-9)


def test_q_is_a_low_pass_of_its_bandwidth():
    q = nominal()
    response = [abs(q(np.exp(1j * w * DT))) for w in (1e-3, W / 10, W, 8 * W)]
    np.testing.assert_allclose(response[:3], [1.0, 1.0, np.sqrt(0.5)], rtol=0.02)
    assert response[3] < 0.03


def test_a_constant_force_is_cancelled_without_an_integrator(cascade, rigid, task):
    run = simulate(Disturbed(rigid, placed(np.ones((1, 1)))), observed(cascade), task)
    # the integral of the PI has nothing to hold
    np.testing.assert_allclose(np.asarray(run.memory.inner)[-1], 0.0, atol=1e-4)
    np.testing.assert_allclose(np.asarray(run.output)[-1], 0.1, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"bandwidth": 0.0}, "bandwidth"),
        ({"input_gain": np.inf}, "input_gain"),
        ({"damping": 1.2}, "damping"),
    ],
)
def test_bad_input_is_named(cascade, changes, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        observed(cascade, **changes)


def test_another_reference_is_named(cascade, task):
    with pytest.raises(ValueError, match="^dt: "):
        observed(cascade, dt=2e-3).initial_memory(task)
    with pytest.raises(ValueError, match="^sensors: "):
        observed(cascade, sensors=Sensors((0, 1))).initial_memory(task)


DATA = numbers_of("single_axis/models")
REDUCED_OBSERVER_DT = 1e-3


class Swinging(Controller):
    """u = f - F x, the same at every step."""

    F: np.ndarray
    preview: int = 1

    def prepare(self, reference):
        return AffinePlan(
            jnp.zeros((reference.steps, 1, 4)), 2.0 * jnp.sin(jnp.arange(reference.steps))[:, None]
        )

    def initial_memory(self, reference):
        return jnp.zeros((0,))

    def step(self, memory, plan, measurement):
        return memory, plan.f - self.F @ measurement


@cache
def inner():
    return Swinging(np.array([[2e3, 30.0, -1.9e3, 1.0]]))


@pytest.mark.parametrize(("name", "make"), [("euler", euler_model), ("zoh", zoh_model)])
def test_thesis_observer(name, make):
    """The printed gain: stable with the exact model, not with the printed one."""
    model, wanted = make(thesis_axis(), REDUCED_OBSERVER_DT), DATA[name]
    moduli = np.sort(np.abs(np.linalg.eigvals(error_matrix(model, thesis_gain()))))
    np.testing.assert_allclose(moduli, wanted["abs_eig_Lambda"], rtol=0, atol=1e-12)
    if name == "euler":
        augmented = augmented_model(model, thesis_gain())
        for actual, key in (
            (augmented.A, "A_aug"),
            (np.asarray(augmented.B)[:, 0], "B_aug"),
            (augmented.C, "C_aug"),
        ):
            np.testing.assert_allclose(actual, wanted[key], rtol=0, atol=1e-12)
        with pytest.raises(
            ValueError,
            match=r"gain: the observer is not stable: .* they are \[0\.99.*\+0\.0\d+j 0\.99.*\]",
        ):
            ReducedObserver(inner(), model, thesis_gain())


@pytest.fixture(scope="module")
def machine(thesis_model):
    """The model as a machine that measures its motor."""
    return Sensed(thesis_model, lambda x: (x[:1], x[1:2]))


def test_estimation_error_obeys_lambda_under_any_control(machine, thesis_model):
    task = thesis_task_a()
    off = np.array([1e-3, -0.02])
    begin = thesis_model.initial_state(np.asarray(task.position)[0], task.start_increment)
    start = np.asarray(begin) + np.concatenate([[0, 0], off])
    run = simulate(machine, ReducedObserver(inner(), thesis_model, thesis_gain()), task, start)
    states = np.asarray(run.state)
    estimate = np.asarray(run.memory.z) + states[:, :2] @ thesis_gain().T
    assert np.abs(states).max() > 1e-2
    Lambda = np.asarray(error_matrix(thesis_model, thesis_gain()))
    for k in (0, 1, 7, 400):
        np.testing.assert_allclose(
            states[k, 2:] - estimate[k], np.linalg.matrix_power(Lambda, k) @ off, rtol=0, atol=1e-12
        )


def test_a_perfect_start_is_state_feedback(machine, thesis_model):
    task = thesis_task_a()
    actual = simulate(machine, ReducedObserver(inner(), thesis_model, thesis_gain()), task)
    wanted = simulate(thesis_model, inner(), task)
    np.testing.assert_allclose(
        actual.control, wanted.control, rtol=0, atol=1e-8 * np.abs(wanted.control).max()
    )


def test_bad_gains_are_named(thesis_model):
    with pytest.raises(ValueError, match="^gain: needs shape"):
        ReducedObserver(inner(), thesis_model, np.zeros((2, 1)))
    with pytest.raises(ValueError, match="^gain: the observer is not stable"):
        ReducedObserver(inner(), thesis_model, np.array([[0.0, -1.0], [0.0, -1.0]]))


COMPANIONS = numbers_of("adaptive/companions")
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
    target = Commanded(*map(placed, np.array([[0.1, -0.1], [0.0, 0.0], [0.0, 0.0]])))
    past = Past(*map(placed, np.zeros((2, 2))))
    step = eqx.filter_jit(controller.step)
    memory, control = step(past, target, (np.zeros(2), np.zeros(2)))
    np.testing.assert_array_equal(control, [0.5, -2.0])
    np.testing.assert_array_equal(memory.control, [0.5, -2.0])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((-1.0, 1.0, 1.0, motors(1), PERIOD), "stiffness: needs to be finite"),
        ((1.0, 1.0, 0.0, motors(1), PERIOD), "input_gain: needs to be finite and above zero"),
        ((1.0, 1.0, 1.0, motors(1), PERIOD, 0.0), "limit: needs to be above zero"),
        ((1.0, 1.0, 1.0, motors(1), PERIOD, np.nan), "limit: needs to be above zero"),
        ((1.0, 1.0, 1.0, Sensors((0,)), PERIOD), "sensors: time-delay control needs speeds"),
    ],
)
def test_bad_input(arguments, says):
    with pytest.raises(ValueError, match=says):
        TimeDelayControl(*arguments)
