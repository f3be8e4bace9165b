"""The sampled law on its plant against reference numbers, a plain loop and differences.

Master-slave synchronisation.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.synchronisation.adaptive import (
    AdaptiveSynchronisation,
    MasterSlave,
    SynchronisedGains,
    coupled_errors,
)
from jcontour.controllers.synchronisation.speed_axes import speed_axes
from jcontour.motion.references import from_samples
from jcontour.plants.actuation import Disturbed
from jcontour.plants.linear_machines import servo_axes
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate
from tests.canonical import DT, reference, round_path

STATE = Sensors((0, 2), (1, 3))  # of `servo_axes`: y, v of one axis, then of the other


def following(speeds, dt):
    """Reference of two axes that share these speeds; the last two samples are preview."""
    path = np.concatenate([[0.0], np.cumsum(speeds[:-1]) * dt])
    along = np.full((len(path), 2), np.sqrt(0.5))
    return from_samples(np.stack([path, path], axis=1), along, dt, preview=2)


def run(p, sampled, beta, speeds, estimate=None):
    """Errors (T, 2) of the law on the parameters of the reference numbers."""
    dt, axes = sampled["T_s"], speed_axes(p["a"], p["b"])
    steps = len(speeds) - 2
    force = np.zeros((steps, 2))
    force[round(p["t_step"] / dt) :, 1] = p["d2_step"]
    plant = Disturbed(servo_axes(p["b"], p["a"], dt), placed(force))
    gains = SynchronisedGains(p["kc"], sampled["gamma_d"], beta, bias=p["v_c"])
    start = axes.feedforward(dt) if estimate is None else estimate
    controller = AdaptiveSynchronisation(gains, STATE, dt, start)
    rollout = simulate(plant, controller, following(speeds, dt))
    return speeds[:steps, None] - np.asarray(rollout.measurement)[:, 1::2], rollout


def scores(error, first, dt):
    apart = np.abs(error[first:, 0] - error[first:, 1])
    peaks = np.abs(error[first:]).max(axis=0)
    return [apart.max(), np.trapezoid(apart, dx=dt), *peaks, apart[-1]]


@pytest.mark.parametrize("name", ["sync_low_kc", "sync_nominal"])
def test_a_step_of_load(synchronisation_numbers, name):
    p = synchronisation_numbers[name]["parameters"]
    for sampled in synchronisation_numbers[name]["discrete"]:
        dt = sampled["T_s"]
        speeds = np.full(round(p["t_end"] / dt) + 3, p["omega_d"])
        for row in sampled["rows"]:
            error, _ = run(p, sampled, row["beta"], speeds)
            if row["peak_sync"] == "diverged":
                assert np.abs(error).max() > 1e6
                continue
            actual = scores(error, round(p["t_step"] / dt), dt)
            keys = ("peak_sync", "iae_sync", "peak_e1", "peak_e2", "final_sync")
            wanted = [row[key] for key in keys]
            np.testing.assert_allclose(actual, wanted, rtol=1e-8, atol=1e-11)


def test_a_speed_that_moves(synchronisation_numbers):
    reference = synchronisation_numbers["sync_time_varying"]
    p = synchronisation_numbers["sync_nominal"]["parameters"]
    sampled = synchronisation_numbers["sync_nominal"]["discrete"][0]
    size, frequency = reference["wave"]
    k = np.arange(603)
    speeds = 1 + size * np.sin(2 * np.pi * frequency * k * 2e-3)
    error, _ = run(p, sampled, reference["beta"], speeds)
    at = np.round(np.array(reference["t"]) / 2e-3).astype(int)
    for axis, key in enumerate(("discrete_2ms_e1", "discrete_2ms_e2")):
        np.testing.assert_allclose(error[at, axis], reference[key], rtol=1e-8, atol=1e-11)


def plain_loop(axes, gains, speeds, dt, force):
    """The equations of the paper, one sample and one axis after the other."""
    a_d, b_d = axes.sampled(dt)
    k_c, gamma, beta, bias = gains
    theta = axes.feedforward(dt)
    omega, phi, errors = np.full(2, speeds[0]), np.zeros(3), []
    for k in range(len(speeds) - 2):
        e = speeds[k] - omega
        apart = e[0] - e[1]
        star = np.array([e[0] + beta * apart, e[1] - beta * apart])
        for i in range(2):
            theta[i] += gamma * phi * star[i]
        phi = np.array([speeds[k], speeds[k + 1], bias])
        u = [k_c[i] * star[i] + theta[i] @ phi for i in range(2)]
        errors.append(e)
        omega = a_d * omega + b_d * (np.array(u) + force[k])
    return np.array(errors), theta


def test_unequal_axes_and_a_load_that_moves():
    axes, dt, random = speed_axes([10.0, 4.0], [50.0, 70.0]), 2e-3, np.random.default_rng(3)
    speeds = 0.5 + 0.1 * np.sin(0.02 * np.arange(302))
    force = 0.1 * random.standard_normal((300, 2))
    wanted, theta = plain_loop(axes, ([0.3, 0.2], 0.02, 1.7, 0.5), speeds, dt, force)
    gains = SynchronisedGains([0.3, 0.2], 0.02, 1.7, bias=0.5)
    controller = AdaptiveSynchronisation(gains, STATE, dt, axes.feedforward(dt))
    plant = Disturbed(servo_axes(axes.gain, axes.pole, dt), placed(force))
    actual = simulate(plant, controller, following(speeds, dt))
    error = speeds[:300, None] - np.asarray(actual.measurement)[:, 1::2]
    np.testing.assert_allclose(error, wanted, rtol=0, atol=1e-11)
    np.testing.assert_allclose(actual.final_memory.estimate, theta, rtol=0, atol=1e-11)


def test_positions_are_held_by_their_own_gain():
    """A load leaves no error in the position once the estimates have taken it over."""
    axes, dt = speed_axes([10.0, 10.0], 50.0), 2e-3
    plant = Disturbed(servo_axes(axes.gain, axes.pole, dt), placed(np.array([[0.0, 1.0]])))
    gains = SynchronisedGains(0.3, 0.022, 2.0, position=20.0)
    controller = AdaptiveSynchronisation(gains, STATE, dt, axes.feedforward(dt))
    rollout = simulate(plant, controller, following(np.full(3003, 0.3), dt))
    wanted = 0.3 * dt * np.arange(3001)
    away = np.abs(np.asarray(rollout.output) - wanted[:, None])
    assert away[:, 1].max() > 1e-3 and away[-1].max() < 1e-9


def test_a_third_axis_stays_to_itself():
    error = np.array([1.0, 2.0, 4.0])
    coupled = jax.jit(coupled_errors, static_argnums=2)
    np.testing.assert_allclose(coupled(error, 0.5, (1, 2)), [1.0, 1.0, 5.0])
    np.testing.assert_allclose(coupled(error, 0.5, (2, 0)), [-0.5, 2.0, 5.5])


def test_bad_input(any_type):
    gains = SynchronisedGains(0.3, 0.02, 1.0)
    with pytest.raises(ValueError, match="dt: needs to be above zero"):
        AdaptiveSynchronisation(gains, motors(2), 0.0)
    with pytest.raises(ValueError, match="sensors: speeds are synchronised"):
        AdaptiveSynchronisation(gains, Sensors((0, 1)), 1e-3)
    for pair in ((0, 0), (0, 2), (-1, 0)):
        with pytest.raises(ValueError, match="pair: needs two of the 2 axes"):
            AdaptiveSynchronisation(gains, motors(2), 1e-3, pair=pair)
    with pytest.raises(ValueError, match="start: needs the shape"):
        AdaptiveSynchronisation(gains, motors(2), 1e-3, start=np.zeros((3, 2)))
    with pytest.raises(ValueError, match="coupling: needs to be finite and at least zero"):
        SynchronisedGains(0.3, 0.02, -1.0)
    with pytest.raises(ValueError, match="bias: needs to be finite and above zero"):
        SynchronisedGains(0.3, 0.02, 1.0, bias=0.0)


LOOPS = Cascade(CascadeGains(30.0, 20.0, 0.02, 1.0), motors(2), DT)


@pytest.mark.parametrize("coupling", [0.0, 0.4, 1.0])
def test_the_slave_follows_the_master(coupling):
    """Its loop is the cascade of a reference that is moved by the master's error."""
    path, law = reference(round_path(2)), MasterSlave(LOOPS, (0, 1), coupling)
    plan = jax.tree.map(lambda rows: rows[3], law.prepare(path))
    position, speed = np.array([1e-3, 2e-4]), np.array([0.02, 0.03])
    _, control = law.step(jnp.zeros(2), plan, (position, speed))
    r, v = np.asarray(plan.position), np.asarray(plan.velocity)
    moved = r + coupling * np.array([0.0, position[0] - r[0]])
    wanted = v + coupling * np.array([0.0, speed[0] - v[0]])
    error = 30.0 * (moved - position) + wanted - speed
    np.testing.assert_allclose(control, 20.0 * (1 + DT / 0.02) * error, rtol=1e-10)


def test_two_different_axes_are_needed():
    with pytest.raises(ValueError, match="pair: needs two of the 2 axes"):
        MasterSlave(LOOPS, (0, 2))
