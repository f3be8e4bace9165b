"""Dry friction against closed forms, and against sticking and slipping in fine steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour import contours, feed_laws, references, simulate
from jcontour.controller import Controller
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.wrappers.dry_friction import SLOWEST, LostMotion, with_dry_friction
from jcontour.plants.wrappers.encoders import Encoders

DT, GAIN, FORCE = 1e-3, 0.8, 0.3  # s, (m/s^2) per control unit, control unit


def slides(axes: int = 1) -> LinearPlant:
    """Masses that a force pushes."""
    A = np.kron(np.eye(axes), [[1.0, DT], [0.0, 1.0]])
    B = np.kron(np.eye(axes), [[GAIN * DT**2 / 2], [GAIN * DT]])
    return LinearPlant(A, B, np.kron(np.eye(axes), [[1.0, 0.0]]), DT)


def rubbed(axes: int = 1):
    plant = slides(axes)
    return with_dry_friction(plant, np.asarray(plant.B), np.full(axes, FORCE))


@jax.jit
def pushed(plant, speed, push):
    """State and place after a second under one push, begun at a speed."""
    state = plant.initial_state(jnp.zeros(1), jnp.full(1, speed * DT))
    state = jax.lax.fori_loop(0, 1000, lambda _, one: plant.step(one, jnp.full(1, push)), state)
    return state, plant.output(state)[0]


def test_it_comes_to_rest_after_the_way_of_a_constant_deceleration():
    state, place = pushed(rubbed(), speed := 0.05, 0.0)
    assert float(place) == pytest.approx(speed**2 / (2 * GAIN * FORCE), rel=0.03)
    assert abs(float(state[1])) < 1e-6


@pytest.mark.parametrize("push", [-0.9, 0.5])
def test_less_than_the_friction_hardly_moves_it(push):
    state, _ = pushed(rubbed(), 0.0, push * FORCE)
    creeping = max(SLOWEST, 4 * FORCE * GAIN * DT) * np.arctanh(abs(push))
    assert abs(float(state[1])) == pytest.approx(creeping, rel=1e-3)


def test_more_than_the_friction_accelerates_it_by_the_rest():
    state, _ = pushed(rubbed(), 0.0, 1.5 * FORCE)
    assert float(state[1]) == pytest.approx(GAIN * 0.5 * FORCE, rel=0.05)


def test_a_delay_of_the_control_does_not_delay_it():
    late = with_input_delay(slides(), 2)
    entry = np.asarray(late.A)[:, -1:]
    delayed = with_dry_friction(late, entry, np.array([FORCE]))
    ways = [float(pushed(plant, 0.05, 0.0)[1]) for plant in (rubbed(), delayed)]
    assert ways[0] == pytest.approx(ways[1], rel=1e-12)


class Feedback(Controller):
    """u = k (y_d - y) + d (v_d - v) + v_d' / gain, its speed from the last two positions."""

    preview: int = 1

    def prepare(self, reference):
        position = reference.position[: reference.steps + 1]
        speed = jnp.diff(position, axis=0, append=position[-1:]) / reference.dt
        push = jnp.diff(speed, axis=0) / reference.dt / GAIN
        return position[:-1], speed[:-1], push

    def initial_memory(self, reference):
        return reference.position[0]

    def step(self, memory, plan, measurement):
        position, speed, push = plan
        measured = (measurement - memory) / DT
        control = 2e4 * (position - measurement) + 250 * (speed - measured) + push
        return measurement, control


def circle():
    path = contours.circle(2e-3)
    return references.along(path, feed_laws.constant_feed(path, 0.02, DT), DT, 1, at_rest=False)


def stick_slip(reference, substeps: int = 50) -> np.ndarray:
    """The same loop in fine steps; friction is what stops a slide, within its force."""
    position = np.asarray(reference.position)
    speed = np.diff(position, axis=0) / DT
    push = np.diff(speed, axis=0) / DT / GAIN
    y, v, before, found = position[0].copy(), speed[0].copy(), position[0], []
    for k in range(reference.steps):
        found.append(y.copy())
        u = 2e4 * (position[k] - y) + 250 * (speed[k] - (y - before) / DT)
        u, before, h = u + (push[k] if k < len(push) else 0.0), y.copy(), DT / substeps
        for _ in range(substeps):
            needed = (v + GAIN * h * u) / (GAIN * h)
            v = v + GAIN * h * (u - np.clip(needed, -FORCE, FORCE))
            y = y + h * v
    return np.array(found)


def test_errors_on_a_circle_are_those_of_sticking_and_slipping():
    reference = circle()
    run = simulate(Encoders(rubbed(2)), Feedback(), reference)
    exact = stick_slip(reference)
    target = np.asarray(reference.position)[: reference.steps]
    ours, theirs = np.asarray(run.output) - target, exact - target
    settled = slice(reference.steps // 8, None)
    peak = np.abs(theirs[settled]).max()
    assert np.abs(ours[settled] - theirs[settled]).max() < 0.25 * peak
    sizes = [np.sqrt(np.mean(error[settled] ** 2)) for error in (ours, theirs)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.1)
    free = np.asarray(simulate(Encoders(slides(2)), Feedback(), reference).output) - target
    assert np.abs(free[settled]).max() < 0.5 * peak


def test_a_run_has_a_slope_by_its_friction():
    plant, reference = rubbed(2), circle()

    def error(share):
        rough = eqx.tree_at(lambda one: one.entry, plant, share * plant.entry)
        run = simulate(Encoders(rough), Feedback(), reference)
        return jnp.sqrt(jnp.mean((run.output - reference.position[: reference.steps]) ** 2))

    both = jax.jit(jax.vmap(jax.value_and_grad(error)))(np.array([1.0, 1.001, 0.999]))
    (_, ahead, behind), (slope, *_) = np.asarray(both)
    assert slope == pytest.approx((ahead - behind) / 2e-3, rel=1e-2)


def test_a_negative_force_is_refused():
    plant = slides()
    with pytest.raises(ValueError, match="coulomb"):
        with_dry_friction(plant, np.asarray(plant.B), np.array([-1.0]))


def test_a_position_loop_with_friction_is_the_play_of_its_command():
    """Against the cascade k_v (k_p (u - x) - v) on a mass with Coulomb friction, in fine steps."""
    kp, kv, mass, friction, substeps = 50.0, 3e4, 30.0, 60.0, 40
    time = DT * np.arange(1500)
    command = 1e-3 * np.sin(2 * np.pi * 1.5 * np.minimum(time, 7 / 6))  # ends at an extreme
    x, v, exact, h = 0.0, 0.0, [], DT / substeps
    for wanted in command:
        exact.append(x)
        for _ in range(substeps):
            needed = v * mass / h + kv * (kp * (wanted - x) - v)
            v += h / mass * (kv * (kp * (wanted - x) - v) - np.clip(needed, -friction, friction))
            x += h * v
    pole = np.exp(-kp * DT)
    servo = LinearPlant([[pole]], [[1 - pole]], [[1.0]], DT)
    stuck = with_dry_friction(servo, np.asarray(servo.B), np.array([friction / (kv * kp)]))
    assert isinstance(stuck, LostMotion)

    def one(state, control):
        return stuck.step(state, control[None]), stuck.output(state)[0]

    start = stuck.initial_state(jnp.zeros(1), jnp.zeros(1))
    _, ours = jax.lax.scan(one, start, jnp.asarray(command))
    assert np.abs(np.asarray(ours) - exact).max() < 0.3 * friction / (kv * kp)
    assert float(ours[-1]) == pytest.approx(exact[-1], abs=0.15 * friction / (kv * kp))
    off = abs(exact[-1] - command[-1])  # it sticks away from its command
    assert off > 0.5 * friction / (kv * kp)
