import control
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.observers.disturbance_observer import DisturbanceObserver
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import zoh
from jcontour.motion.point_to_point import thesis_task_a
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate

DT, B0, W = 1e-3, 2.0, 300.0
SENSORS = motors(1)
CASCADE = Cascade(CascadeGains(30.0, 20.0, 0.1), SENSORS, DT)
RIGID = LinearPlant(
    *zoh([[0.0, 1.0], [0.0, 0.0]], [[0.0], [B0]], DT), [[1.0, 0.0]], DT
)  # the nominal model itself
TASK = thesis_task_a()


def nominal():
    """Q of the docstring, by python-control."""
    poles = np.poly(np.exp(DT * np.roots([1.0, np.sqrt(2) * W, W**2])))
    return control.tf(np.sum(poles) / 2 * np.array([1.0, 1.0]), poles, DT)


def forced(force):
    """The estimates of the observer on the nominal machine under a force, and the force itself."""
    controller = DisturbanceObserver(CASCADE, SENSORS, W, B0, DT)
    run = simulate(Disturbed(RIGID, jnp.asarray(force)[:, None]), controller, TASK)
    inside = simulate(RIGID, CASCADE, TASK)
    return run, inside


def test_the_nominal_machine_is_left_as_it_was():
    run, inside = forced(np.zeros(2))
    np.testing.assert_allclose(run.output, inside.output, rtol=0, atol=1e-12)


def test_the_estimate_is_the_disturbance_through_q():
    """Whatever the loop does: against the response by python-control."""
    force = np.random.default_rng(0).standard_normal(TASK.steps)
    run, _ = forced(force)
    estimate = np.asarray(run.memory.first)[:, 0]
    x = np.asarray(run.state[0])[:, 0]
    inverse = float(DisturbanceObserver(CASCADE, SENSORS, W, B0, DT)._filters()[1])
    wanted = control.forced_response(nominal(), U=force).outputs
    np.testing.assert_allclose(estimate + inverse * x, wanted, rtol=0, atol=1e-9)


def test_q_is_a_low_pass_of_its_bandwidth():
    q = nominal()
    response = [abs(q(np.exp(1j * w * DT))) for w in (1e-3, W / 10, W, 8 * W)]
    np.testing.assert_allclose(response[:3], [1.0, 1.0, np.sqrt(0.5)], rtol=0.02)
    assert response[3] < 0.03


def test_a_constant_force_is_cancelled_without_an_integrator():
    run = simulate(
        Disturbed(RIGID, jnp.ones((1, 1))), DisturbanceObserver(CASCADE, SENSORS, W, B0, DT), TASK
    )
    np.testing.assert_allclose(
        run.memory.inner[-1], 0.0, atol=1e-4
    )  # the PI's integral has nothing to hold
    np.testing.assert_allclose(run.output[-1], 0.1, atol=1e-6)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: DisturbanceObserver(CASCADE, SENSORS, 0.0, B0, DT), "bandwidth"),
        (lambda: DisturbanceObserver(CASCADE, SENSORS, W, np.inf, DT), "input_gain"),
        (lambda: DisturbanceObserver(CASCADE, SENSORS, W, B0, DT, 1.2), "damping"),
        (lambda: DisturbanceObserver(CASCADE, SENSORS, W, B0, 2e-3).initial_memory(TASK), "dt"),
        (
            lambda: DisturbanceObserver(CASCADE, Sensors((0, 1)), W, B0, DT).initial_memory(TASK),
            "sensors",
        ),
    ],
)
def test_bad_input_is_named(make, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        make()
