from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.observers.extended_state_observers import (
    CurrentLESO,
    DisturbanceRejection,
    Estimate,
    EulerLESO,
    ExactLESO,
)
from jcontour.motion.point_to_point import thesis_task_a, thesis_task_b
from jcontour.plants.actuation import Disturbed
from jcontour.plants.flexible_axis.axis import AxisParameters, FlexibleAxis, thesis_axis
from jcontour.plants.friction import Friction
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

ROWS = numbers_of("single_axis/metrics_only")
DT, B0 = 1e-3, 79.33 / 39.62
FORMS = {"exact": ExactLESO, "euler": EulerLESO, "current": CurrentLESO}


@cache
def one_motor():
    return motors(1)


# thesis, section 3.4.2
@cache
def thesis_cascade():
    return Cascade(CascadeGains(30.0, 55.67, 0.04), one_motor(), DT)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROWS)
def test_reference_numbers_of_the_thesis_loop(name):
    task, _, form = name.split()
    reference = thesis_task_a() if task == "A" else thesis_task_b()
    controller = DisturbanceRejection(thesis_cascade(), FORMS[form](700.0, B0, DT), one_motor())
    run = jax.device_get(simulate(FlexibleAxis(thesis_axis(), DT), controller, reference))
    wanted, current = np.asarray(reference.position)[:-1], np.abs(run.control)[:-1]
    motor, tool = np.abs(run.state.motion.motor - wanted), np.abs(run.state.motion.tool - wanted)
    actual = {
        "em_max": motor.max(),
        "em_mean": motor.mean(),
        "ee_max": tool.max(),
        "ee_mean": tool.mean(),
    }
    actual["def_max"] = np.abs(run.state.motion.motor - run.state.motion.tool).max()
    actual = {key: 1e3 * value for key, value in actual.items()} | {
        "u_mean": current.mean(),
        "u_max": current.max(),
    }
    for key, value in ROWS[name].items():
        np.testing.assert_allclose(actual[key], value, rtol=1e-8, err_msg=key)


def updated(observer, z, u, before, now):
    row = lambda value: np.array([value])  # noqa: E731
    update = eqx.filter_jit(observer.update)
    return np.concatenate(update(Estimate(*map(row, z)), row(u), row(before), row(now)))


def test_the_current_form_knows_a_constant_disturbance_after_three_samples_of_a_dead_beat():
    """Its error obeys (I - l C) Ad, with a triple pole at exp(-w T)."""
    w = 300.0
    observer = CurrentLESO(w, B0, DT)
    jacobian = jax.jacfwd(
        lambda z: jnp.concatenate(observer.update(Estimate(*z[:, None]), *jnp.zeros((3, 1))))
    )
    polynomial = np.poly(np.asarray(jax.jit(jacobian)(np.zeros(3))))
    np.testing.assert_allclose(polynomial, np.poly([np.exp(-w * DT)] * 3), atol=1e-9)

    fast, z, truth = CurrentLESO(1e5, B0, DT), np.zeros(3), np.array([1e-3, 0.1, 2.0])
    for _ in range(3):
        truth = np.array(
            [
                truth[0] + DT * truth[1] + DT**2 / 2 * (truth[2] + B0),
                truth[1] + DT * (truth[2] + B0),
                truth[2],
            ]
        )
        z = updated(fast, z, 1.0, np.nan, truth[0])
    np.testing.assert_allclose(z, truth, rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [ExactLESO, CurrentLESO])
def test_a_constant_force_is_found_and_cancelled(kind):
    """Without an integrator inside: the proportional loop alone would be left with an offset."""
    observer = kind(700.0, B0, DT)
    inside = Cascade(CascadeGains(30.0, 55.67, 1e9), one_motor(), DT)
    task = thesis_task_a()
    smooth = AxisParameters(
        39.62, 0.38, 2908.0, 50.0, 79.33, Friction(0.0, 0.0, 1.0, 0.0), [0.0], [0.0], 0.0875
    )  # well damped
    axis = Disturbed(FlexibleAxis(smooth, DT), placed(np.ones((1, 1))))
    errors = []
    for controller in (inside, DisturbanceRejection(inside, observer, one_motor())):
        run = simulate(axis, controller, task)
        errors.append(abs(float(np.asarray(run.output)[-1, 0]) - 0.1))
    assert errors[0] > 5e-4 and errors[1] < 1e-3 * errors[0]


def test_bad_observers_are_named():
    wanted = "below 2000 rad/s, with forward Euler all eigenvalues are -1.5"
    with pytest.raises(ValueError, match=f"bandwidth: needs to be {wanted}"):
        EulerLESO(2500.0, B0, DT)
    for make, name in [
        (lambda: ExactLESO(-1.0, B0, DT), "bandwidth"),
        (lambda: CurrentLESO(1.0, np.nan, DT), "input_gain"),
        (
            lambda: DisturbanceRejection(
                thesis_cascade(), ExactLESO(1.0, B0, 2e-3), one_motor()
            ).initial_memory(thesis_task_a()),
            "dt",
        ),
        (
            lambda: DisturbanceRejection(
                thesis_cascade(), ExactLESO(1.0, B0, DT), Sensors((0, 1))
            ).initial_memory(thesis_task_a()),
            "sensors",
        ),
    ]:
        with pytest.raises(ValueError, match=f"^{name}: "):
            make()
