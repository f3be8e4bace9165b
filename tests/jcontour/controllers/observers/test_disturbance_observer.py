import control
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.observers.disturbance_observer import DisturbanceObserver
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import zoh
from jcontour.motion.point_to_point import thesis_task_a
from jcontour.plants.actuation import Disturbed
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate

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
