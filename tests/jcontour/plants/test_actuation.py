"""Other input gains: B times the gains, but for what holds the plant where a run begins.

Backlash in a plant, its compensation, and what an audit finds of it.

Dry friction against closed forms, and against sticking and slipping in fine steps.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from jcontour import contours, feed_laws, references, simulate
from jcontour._arrays import placed
from jcontour.analysis.frozen_loops import linear_machine
from jcontour.controller import Controller
from jcontour.controllers import BacklashCompensation, ContouringLQ, LQWeights
from jcontour.linear.plant import LinearPlant, spectral_radius
from jcontour.linear.transformations import with_input_delay, with_input_gains
from jcontour.plants import bridgeport
from jcontour.plants.actuation import (
    SLOWEST,
    Backlash,
    Delayed,
    Disturbed,
    ElastoplasticFriction,
    Gained,
    PartlyDelayed,
    Saturated,
    WithDryFriction,
    with_dry_friction,
)
from jcontour.plants.encoders import CountingEncoders, Encoders
from jcontour.plants.friction import without_dry_friction
from jcontour.sensors import Sensors
from jcontour.simulation.metrics import contour_error
from tuning.identification.error_causes import shares
from tuning.identification.linear.axis_model import AxisModel

GAINS = np.array([1.2, 0.7])
PLACE = jnp.array([0.03, -0.05])  # [m]


@pytest.fixture(scope="module")
def position_drives():
    """Drives that take a position, y = u at rest, one of them a sample late."""
    A, B, C = np.diag([0.9, 0.8]), np.diag([0.1, 0.2]), np.eye(2)
    return with_input_delay(LinearPlant(A, B, C, 1e-3), 1)


def test_integrating_axes_answer_as_with_other_input_gains(two_axes, start, controls, run):
    plant = Gained(two_axes, GAINS)
    state = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    found = run(plant, state, controls)
    wanted = run(with_input_gains(two_axes, GAINS), start, controls)
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-13)


def test_a_position_drive_stands_where_the_run_begins(position_drives, run):
    """Held by the control of the nominal plant; a step from there is `gains` times as high."""
    plant, step = Gained(position_drives, GAINS), np.array([1e-3, 2e-3])
    rest = plant.initial_state(PLACE, np.zeros(2))
    still, _, _ = run(plant, rest, np.tile(PLACE, (5, 1)))
    np.testing.assert_allclose(still, np.tile(PLACE, (5, 1)), rtol=1e-14)
    stepped, _, _ = run(plant, rest, np.tile(PLACE + step, (300, 1)))
    np.testing.assert_allclose(stepped[-1], PLACE + GAINS * step, rtol=1e-12)


@pytest.mark.parametrize(("late", "kind"), [(Delayed, int), (PartlyDelayed, float)])
def test_a_late_drive_stands_still_too(late, kind, position_drives, run):
    """Its line holds the control that holds it, whatever its gains."""
    plant = Gained(late(position_drives, np.asarray(2.0).astype(kind), 2, 2), GAINS)
    still, _, _ = run(plant, plant.initial_state(PLACE, np.zeros(2)), np.tile(PLACE, (6, 1)))
    np.testing.assert_allclose(still, np.tile(PLACE, (6, 1)), rtol=1e-14)


def test_the_kept_control_is_no_part_of_a_frozen_loop(position_drives):
    plant = Gained(position_drives, GAINS)
    state = plant.initial_state(PLACE, np.zeros(2))
    A, B, _ = jax.jit(lambda state: linear_machine(plant, state, PLACE))(state)
    np.testing.assert_allclose(A, position_drives.A, atol=1e-15)
    np.testing.assert_allclose(B, position_drives.B * GAINS[None], atol=1e-15)
    assert spectral_radius(A) < 1


@pytest.mark.parametrize("gain", [0.0, -1.0, np.inf])
def test_a_gain_that_is_none_is_refused(gain, two_axes):
    with pytest.raises(ValueError, match="gains"):
        Gained(two_axes, gain)


def test_saturated_clips_each_control(two_axes, start, controls, run):
    limit = np.array([5e-3, 1.0])
    found = run(Saturated(two_axes, limit), start, controls)
    wanted = run(two_axes, start, np.clip(controls, -limit, limit))
    np.testing.assert_array_equal(found[0], wanted[0])
    assert np.abs(controls[:, 0]).max() > limit[0]


@pytest.mark.parametrize("limit", [[1.0, -1.0], [np.nan, 1.0]])
def test_a_limit_below_zero_is_refused(limit, two_axes):
    with pytest.raises(ValueError, match="limit"):
        Saturated(two_axes, jnp.array(limit))


GAP = np.array([0.0, 12e-6])


@pytest.fixture(scope="module")
def runs():
    """Reference, and rollouts of the loose machine without and with compensation."""
    machine, path = bridgeport(), contours.lemniscate(3e-3)
    controller = ContouringLQ(machine, LQWeights(1.2, 20.0, 2e-9), preview=5)
    arc = feed_laws.constant_feed(path, 0.02, machine.dt)
    reference = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    loose = Backlash(machine, jnp.asarray(GAP))
    both = controller, BacklashCompensation(controller, jnp.asarray(GAP))
    return reference, [simulate(loose, one, reference) for one in both]


def test_the_tool_follows_the_motor_through_the_gap():
    """To and fro by hand: half a gap behind, and at rest while the motor crosses the gap."""
    machine = bridgeport()
    loose = Backlash(machine, jnp.asarray(GAP))
    state, motor, tool = loose.initial_state(jnp.zeros(2), jnp.zeros(2)), [], []
    for k in range(80):
        state = loose.step(state, jnp.array([1.0, 2.0 if k % 40 < 20 else -2.0]))
        motor.append(np.asarray(machine.output(state[0])))
        tool.append(np.asarray(loose.output(state)))
    wanted, here = [], np.zeros(2)
    for place in motor:
        behind, ahead = place - GAP / 2, place + GAP / 2
        here = np.where(here < behind, behind, np.where(here > ahead, ahead, here))
        wanted.append(here)
    np.testing.assert_allclose(tool, wanted, atol=1e-15)
    assert np.ptp(np.array(motor)[:, 1]) > 2 * GAP[1]  # it turns through the gap


def test_compensation_takes_most_of_the_error_away(runs):
    reference, rollouts = runs
    errors = [np.linalg.norm(contour_error(one.output, reference), axis=1) for one in rollouts]
    before, after = (np.sqrt(np.mean(one[200:] ** 2)) for one in errors)
    assert before > 3e-6 and after < 0.25 * before


def test_an_audit_finds_the_gap(runs):
    reference, (free, _) = runs
    steps = reference.steps
    asked, tool = np.asarray(reference.position)[:steps], np.asarray(free.output)

    def error_of(places):
        error = np.asarray(contour_error(jnp.asarray(places), reference))
        return error, np.asarray(reference.tangent)[:steps]

    counts, scored = np.full((2, 2), 1e-9), np.arange(steps) > 200
    found = shares(asked, tool, reference.dt, counts, error_of, scored)
    first = found.causes[0]
    assert (first.kind, first.axis) == ("backlash", 1)
    assert first.size == pytest.approx(GAP[1], rel=0.3)


def test_disturbed_adds_rows_and_holds_the_last(two_axes, start, controls, run):
    random = np.random.default_rng(1)
    force, noise = 1e-3 * random.standard_normal((3, 2)), 1e-6 * random.standard_normal((8, 2))
    plant = Disturbed(Encoders(two_axes), placed(force), placed(noise))
    state = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    outputs, measurements, last = run(plant, state, controls)
    wanted = run(two_axes, start, controls + force[np.minimum(np.arange(8), 2)])
    np.testing.assert_allclose(outputs, wanted[0], rtol=1e-14)
    np.testing.assert_allclose(measurements, wanted[0] + noise, rtol=1e-14)
    assert int(last[1]) == 8


def test_wrappers_nest(two_axes, start, controls, run):
    limit = jnp.array([5e-3, 5e-3])
    plant = Encoders(Saturated(Delayed(two_axes, jnp.asarray(1), 2, 2), limit))
    state = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    outputs, measurements, _ = run(plant, state, controls)
    late = np.concatenate([np.zeros((1, 2)), np.clip(controls, -limit, limit)])[:8]
    np.testing.assert_allclose(measurements, run(two_axes, start, late)[0], rtol=1e-14)
    np.testing.assert_array_equal(outputs, measurements)
    assert plant.dt == two_axes.dt


def test_the_output_is_that_of_the_machine_whatever_is_around_it(two_axes, start):
    delayed = Delayed(Saturated(two_axes, jnp.ones(2)), jnp.asarray(1), 2, 2)
    wrapped = CountingEncoders(Disturbed(delayed), Sensors(range(2)), 1e-6)
    state = wrapped.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    np.testing.assert_array_equal(wrapped.output(state), two_axes.output(start))


DT, GAIN, FORCE = 1e-3, 0.8, 0.3  # s, (m/s^2) per control unit, control unit


def slides(axes: int = 1) -> LinearPlant:
    """Masses that a force pushes."""
    A = np.kron(np.eye(axes), [[1.0, DT], [0.0, 1.0]])
    B = np.kron(np.eye(axes), [[GAIN * DT**2 / 2], [GAIN * DT]])
    return LinearPlant(A, B, np.kron(np.eye(axes), [[1.0, 0.0]]), DT)


# [m/s per control unit] half of the slope 2 / (GAIN DT) at which a mass is no longer stable, or one
# step of the search more
TURNS = pytest.approx(GAIN * DT, rel=0.11)


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
    """It creeps where F tanh of the speed without friction balances the push."""
    state, _ = pushed(rubbed(), 0.0, push * FORCE)
    free = abs(float(state[1])) + GAIN * DT * abs(push) * FORCE
    turning = free / np.arctanh(abs(push))
    assert turning > SLOWEST and turning / FORCE == TURNS
    assert abs(float(state[1])) < 0.6 * GAIN * DT * FORCE


def test_an_axis_whose_tool_swings_sticks_as_well():
    """A motor that friction holds, measured behind a spring of 50 Hz: what swings is not held."""
    w, damping = 2 * np.pi * 50.0, 0.02
    flow = np.zeros((4, 4))  # place and speed of a body, and of what hangs on it
    flow[0, 1] = flow[2, 3] = 1.0
    flow[3] = [0.0, 0.0, -(w**2), -2 * damping * w]
    parts = np.zeros((5, 5))
    parts[:4, :4], parts[:4, 4] = flow * DT, np.array([0.0, GAIN, 0.0, -GAIN]) * DT
    whole = expm(parts)
    plant = LinearPlant(whole[:4, :4], whole[:4, 4:], [[1.0, 0.0, 1.0, 0.0]], DT)
    stuck = with_dry_friction(plant, np.asarray(plant.B), np.array([FORCE]))
    state = jnp.array([0.0, 0.0, 1e-5, 0.0])
    swung = []
    for _ in range(400):
        state = stuck.step(state, jnp.array([0.5 * FORCE]))
        swung.append(float(state[2]))
    assert abs(float(state[0])) < 1e-5 and abs(float(state[1])) < 0.02 * GAIN * DT * FORCE
    assert np.ptp(swung[-40:]) == pytest.approx(2e-5 * np.exp(-damping * w * 0.38), rel=0.3)


def test_more_than_the_friction_accelerates_it_by_the_rest():
    state, _ = pushed(rubbed(), 0.0, 1.5 * FORCE)
    assert float(state[1]) == pytest.approx(GAIN * 0.5 * FORCE, rel=0.05)


def test_what_it_is_more_at_rest_falls_to_half_at_its_speed():
    """A push that balances it there is less than breaks it loose, and drives it on from faster."""
    plant, more, v_s = slides(), 0.5 * FORCE, 0.02
    stribeck = with_dry_friction(plant, np.asarray(plant.B), np.full(1, FORCE), (more, v_s))
    balance = FORCE + more / 2
    state, _ = pushed(stribeck, 0.0, balance)
    free = abs(float(state[1])) + GAIN * DT * balance
    assert free / np.arctanh(balance / (FORCE + more)) / (FORCE + more) == TURNS
    state, _ = pushed(stribeck, 2 * v_s, balance)
    assert float(state[1]) > 2 * v_s + 0.5 * GAIN * more / 2
    begun = stribeck.initial_state(jnp.zeros(1), jnp.full(1, v_s * DT))
    slower = stribeck.step(begun, jnp.full(1, balance))
    assert float(slower[1]) == pytest.approx(v_s, rel=2e-2)


def test_friction_acts_when_the_control_arrives():
    """From rest, with a delay of two samples, the same motion comes two samples later."""
    late = with_input_delay(slides(), 2)
    delayed = with_dry_friction(late, np.asarray(late.B), np.array([FORCE]))
    pushes = jnp.asarray(2 * FORCE * np.sin(np.arange(500) / 40))[:, None]

    def moved(plant):
        def one(state, push):
            return plant.step(state, push), plant.output(state)[0]

        start = plant.initial_state(jnp.zeros(1), jnp.zeros(1))
        return np.asarray(jax.lax.scan(one, start, pushes)[1])

    at_once, later = moved(rubbed()), moved(delayed)
    assert np.ptp(at_once) > 1e-4
    np.testing.assert_allclose(later[2:], at_once[:-2], atol=1e-12 * np.ptp(at_once))


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
    assert np.abs(ours[settled] - theirs[settled]).max() < 0.12 * peak
    sizes = [np.sqrt(np.mean(error[settled] ** 2)) for error in (ours, theirs)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.04)
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


@pytest.mark.parametrize(("load", "sign"), [(0.0, 1), (20.0, 1), (20.0, -1)])
def test_a_position_loop_with_friction_is_the_play_of_its_command(load, sign):
    """Against the cascade k_v (k_p (u - x) - v) on a mass with Coulomb friction, in fine steps.

    A load on a spring of 55 Hz has the encoder: what sticks is the motor.
    """
    kp, kv, mass, friction, substeps = 50.0, 3e4, 30.0, 60.0, 40
    w, damping, h = 2 * np.pi * 55, 0.06, DT / substeps
    time = DT * np.arange(1500)
    command = 1e-3 * np.sin(2 * np.pi * 1.5 * np.minimum(time, 7 / 6))  # ends at an extreme
    x, v, tool, speed, exact = 0.0, 0.0, 0.0, 0.0, []
    for wanted in command:
        exact.append(tool if load else x)
        for _ in range(substeps):
            pull = w**2 * (x - tool) + 2 * damping * w * (v - speed)
            needed = v * mass / h + kv * (kp * (wanted - x) - v) - load * pull
            v += h / mass * (needed - v * mass / h - np.clip(needed, -friction, friction))
            speed += h * pull
            x, tool = x + h * v, tool + h * speed
    # x' = k_p (u - x), and the load
    rates = [[-kp, 0, 0], [0, 0, 1], [w**2 - 2 * damping * w * kp, -(w**2), -2 * damping * w]]
    drive = [[kp], [0], [2 * damping * w * kp]]
    both = np.block([[np.array(rates), np.array(drive)], [np.zeros((1, 4))]])
    A, B = np.split(expm(DT * both)[:3], [3], axis=1)
    servo = LinearPlant(A, sign * B, [[0.0, 1.0, 0.0]], DT)
    if not load:
        servo = LinearPlant(A[:1, :1], B[:1], [[1.0]], DT)
    stuck = with_dry_friction(servo, np.asarray(servo.B), np.array([friction / (kv * kp)]))
    assert isinstance(stuck, ElastoplasticFriction)

    def one(state, control):
        return stuck.step(state, control[None]), stuck.output(state)[0]

    start = stuck.initial_state(jnp.zeros(1), jnp.zeros(1))
    _, ours = jax.lax.scan(one, start, jnp.asarray(sign * command))
    assert np.abs(np.asarray(ours) - exact).max() < 0.3 * friction / (kv * kp)
    assert float(ours[-1]) == pytest.approx(exact[-1], abs=0.15 * friction / (kv * kp))
    off = abs(exact[-1] - command[-1])  # it sticks away from its command
    assert off > 0.5 * friction / (kv * kp)


def test_each_axis_has_the_friction_of_its_own_drive():
    """A force slides and a position sticks, each as it does by itself."""
    slide, servo = slides(), LinearPlant([[0.9]], [[0.1]], [[1.0]], DT)
    parts = zip((slide.A, slide.B, slide.C), (servo.A, servo.B, servo.C), strict=True)
    both = LinearPlant(*(block_diag(*map(np.asarray, pair)) for pair in parts), DT)
    force = np.array([FORCE, 1e-3])
    together = with_dry_friction(both, np.asarray(both.B), force)
    alone = [
        with_dry_friction(one, np.asarray(one.B), force[k : k + 1])
        for k, one in enumerate((slide, servo))
    ]
    state = together.initial_state(jnp.zeros(2), jnp.array([1e-6, 1e-5]))
    own = [
        one.initial_state(jnp.zeros(1), jnp.full(1, way))
        for one, way in zip(alone, (1e-6, 1e-5), strict=True)
    ]
    for k in range(20):
        push = jnp.array([0.5 * FORCE, 2e-3 * np.sin(0.3 * k)])
        state = together.step(state, push)
        own = [
            one.step(x, push[i : i + 1]) for i, (one, x) in enumerate(zip(alone, own, strict=True))
        ]
    places = [float(one.output(x)[0]) for one, x in zip(alone, own, strict=True)]
    assert np.asarray(together.output(state)).tolist() == pytest.approx(places, rel=1e-12)


def test_a_loop_is_looked_at_without_what_sticks():
    """Its slope is that of the drive alone: no force acts, none is remembered."""
    servo = LinearPlant([[0.9]], [[0.1]], [[1.0]], DT)
    free = without_dry_friction(with_dry_friction(servo, np.asarray(servo.B), np.array([1e-3])))
    start = free.initial_state(jnp.zeros(1), jnp.zeros(1))
    (state, held) = jax.jacobian(free.step, argnums=0)(start, jnp.zeros(1))
    by_control, _ = jax.jacobian(free.step, argnums=1)(start, jnp.zeros(1))
    assert float(state[0][0, 0]) == 0.9 and float(by_control[0, 0]) == 0.1
    assert not np.any(np.asarray(state[1])) and not np.any(np.asarray(held[1]))


def test_a_force_of_a_machine_of_many_states_is_no_lost_motion():
    """Slides behind a resonance and a delay, as they are identified: they integrate."""
    masses = with_input_delay(slides(), 3)
    assert isinstance(
        with_dry_friction(masses, np.asarray(masses.A)[:, -1:], np.array([FORCE])), WithDryFriction
    )
    below = np.poly([1 + 4e-11, 0.997, 0.983 * np.exp(0.3j), 0.983 * np.exp(-0.3j), 0.9])
    model = AxisModel(np.real(below[1:]), 1e-7 * np.ones(4), 0, 0, DT)
    resonant = LinearPlant(*model.realisation(), DT)
    entry = np.asarray(resonant.B)
    assert isinstance(with_dry_friction(resonant, entry, np.array([FORCE])), WithDryFriction)
