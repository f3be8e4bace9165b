"""Bounds under stick, slip, cogging and counts: never exceeded on the true axis, and close."""

import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour.arrays import placed
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.geometry.contours import line
from jcontour.guarantees.affine import NotAffine
from jcontour.guarantees.friction.friction_bounds import (
    _Sample,
    cogging_size,
    cogging_slope,
    friction_bounds,
)
from jcontour.motion.point_to_point import PointToPoint, thesis_task_a, thesis_task_b
from jcontour.motion.references import along, in_time
from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis
from jcontour.plants.friction import Friction
from jcontour.plants.wrappers.encoders import CountingEncoders, FineEncoders
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate

COUNT = 1e-6  # [m]


def cascade(limit=10.0, **gains):
    found = {"position": 30.0, "velocity": 55.67, "integral_time": 0.04} | gains
    return Cascade(CascadeGains(**found), motors(1), 1e-3, limit=limit)


def steep_axis():
    """The thesis's axis, with a friction that falls within 1 mm/s."""
    p = thesis_axis()
    friction = Friction(36.36, 22.04, 1e-3, p.friction.viscous)
    return FlexibleAxis(eqx.tree_at(lambda p: p.friction, p, friction), 1e-3)


def short_move(law=None):
    """10 mm at 0.1 m/s in a run of 0.2 s."""
    law = law or PointToPoint(0.01, 0.1, 4.0)
    return in_time(line([0.0], [law.distance]), law, 0.2, 1e-3, 1, dwell=0.02)


class Braked:
    """Time law: up to a speed at 0.8 m/s^2, and down at 8 m/s^2."""

    distance = 0.08 * (0.1 + 0.01) / 2

    def __call__(self, time):
        left = np.clip(0.11 - time, 0, 0.01)
        return np.where(time < 0.1, 0.4 * np.minimum(time, 0.1) ** 2, self.distance - 4 * left**2)


def friction_of_a_stop(axis, v, control):
    """Forces at the stages that take the motor to rest in one substep; the axis is at x = 0."""
    p, h = axis.parameters, axis.dt / axis.substeps
    mass, drive = float(p.motor_mass[0]), float(p.force_constant[0]) * control
    speeds, rates, dry = [], [], []
    for share in (0.0, 0.5, 0.5, 1.0):  # x and the link move by less than a micrometre
        speeds.append(v + share * h * rates[-1] if rates else v)
        dry.append(float(np.asarray(p.friction.dry(placed(np.full(1, speeds[-1]))))[0]))
        rates.append((drive - dry[-1] - float(p.friction.viscous[0]) * speeds[-1]) / mass)
    after = v + h / 6 * np.dot([1, 2, 2, 1], rates)
    assert v > 0 and after <= 0
    return -after * mass / h - np.array(dry)


def run(axis, controller, reference):
    """Errors and controls of the true axis."""
    found = simulate(CountingEncoders(axis, motors(1), COUNT), controller, reference)
    wanted = np.asarray(reference.position)[: reference.steps, 0]
    return np.abs(np.asarray(found.output)[:, 0] - wanted), np.abs(np.asarray(found.control)[:, 0])


def attacked(axis, controller, reference, random):
    """As `run`, the position and the speed measured as wrong as counts may make them."""
    plant = FineEncoders(axis, motors(1))
    state, plan = plant.initial_state(np.zeros(1), np.zeros(1)), controller.prepare(reference)
    off = random.choice([-1.0, 1.0], (reference.steps, 2)) * [COUNT / 2, COUNT / axis.dt]

    def step(carried, row):
        (state, memory), (planned, off) = carried, row
        position, speed = plant.measure(state)
        memory, control = controller.step(memory, planned, (position + off[0], speed + off[1]))
        return (plant.step(state, control), memory), (plant.output(state)[0], control[0])

    begin = state, controller.initial_memory(reference)
    _, (output, control) = jax.lax.scan(step, begin, (plan, off))
    wanted = np.asarray(reference.position)[: reference.steps, 0]
    return np.abs(np.asarray(output) - wanted), np.abs(np.asarray(control))


def test_cogging_stays_below_its_size_and_slope():
    p = thesis_axis()
    x = np.linspace(0.0, 0.0875, 4001)
    force = np.array(jax.jit(lambda x: p.cogging(x))(x))
    assert 0.8 * cogging_size(p) < np.abs(force).max() <= cogging_size(p)
    steepest = np.abs(np.diff(force) / np.diff(x)).max()
    assert 0.5 * cogging_slope(p) < steepest <= cogging_slope(p)


def test_a_stop_needs_no_more_friction_than_its_sample_allows():
    """At one stage it needs more than the drive, where the friction of the others falls less."""
    axis = steep_axis()
    nothing = 0 * np.asarray(axis.parameters.cogging_sine)
    axis = eqx.tree_at(
        lambda a: (a.parameters.cogging_sine, a.parameters.cogging_cosine), axis, (nothing, nothing)
    )
    most = 36.36 + 22.04
    for v, share in [(1e-8, 1.0), (1e-6, 1.0), (1e-5, 1.05), (1e-8, 0.9)]:
        control = -share * most / float(axis.parameters.force_constant[0])
        needed = friction_of_a_stop(axis, v, control)
        acting = _Sample(axis).acting(np.array([v, 0.0, 0.0, 0.0]), np.zeros(4), abs(control))
        every, _, beyond = acting.widths
        assert not acting.known
        assert needed.max() <= every + beyond and needed.min() >= -every
        assert (needed.max() > most + 0.2) == (v == 1e-8 and share == 1.0)


@pytest.mark.slow
def test_a_limit_that_is_not_reached_changes_nothing():
    """Friction brakes too: the run without it would reach the limit, no true one does."""
    axis, reference = FlexibleAxis(thesis_axis(), 1e-3), short_move(Braked())
    gains = {"feedforward": 1.0, "inertia": 0.5, "viscous": 3.16}
    free = friction_bounds(axis, cascade(np.inf, **gains), reference, COUNT)
    limited = cascade(1.0001 * free.control.max(), **gains)
    assert np.array_equal(friction_bounds(axis, limited, reference, COUNT).bound, free.bound)


@pytest.mark.slow
@pytest.mark.parametrize("task, least", [(thesis_task_a, 0.80), (thesis_task_b, 0.83)])
def test_the_thesis_tasks_stay_below_their_bound_and_come_close(task, least):
    axis, reference = FlexibleAxis(thesis_axis(), 1e-3), task()
    found = friction_bounds(axis, cascade(), reference, COUNT)
    error, control = run(axis, cascade(), reference)
    assert np.all(error <= found.bound) and np.all(control <= found.control)
    assert error.max() > least * found.bound.max()
    assert 0.4 < found.known.mean() < 0.9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_other_motions_and_gains_stay_below_too(seed):
    """Feedforward makes the friction of these motions almost vanish from the error."""
    random = np.random.default_rng(seed)
    law = PointToPoint(random.uniform(0.002, 0.02), random.uniform(0.03, 0.1), random.uniform(1, 4))
    reference = in_time(line([0.0], [law.distance]), law, 0.6, 1e-3, 1, dwell=0.05)
    gains = {"position": random.uniform(20, 40), "feedforward": random.uniform(0, 1)}
    controller, axis = cascade(**gains, viscous=3.0), FlexibleAxis(thesis_axis(), 1e-3)
    found = friction_bounds(axis, controller, reference, COUNT)
    error, control = run(axis, controller, reference)
    assert np.all(error <= found.bound) and np.all(control <= found.control)
    assert error.max() > 0.3 * found.bound.max()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_friction_that_falls_within_a_millimetre_per_second(seed):
    axis, reference = steep_axis(), short_move()
    controller = cascade(feedforward=0.5, viscous=3.0)
    found = friction_bounds(axis, controller, reference, COUNT)
    error, control = attacked(axis, controller, reference, np.random.default_rng(seed))
    assert np.all(error <= found.bound) and np.all(control <= found.control)
    assert error.max() > 0.3 * found.bound.max()


@pytest.mark.slow
def test_what_has_no_bound_is_told():
    axis = FlexibleAxis(thesis_axis(), 1e-3)
    moving = along(line([0.0], [0.01]), 1e-4 * np.arange(40), 1e-3, 1, at_rest=False)
    with pytest.raises(ValueError, match="reference: needs to begin at rest"):
        friction_bounds(axis, cascade(), moving, COUNT)
    with pytest.raises(NotAffine, match=r"limit: a control of up to .* its limit of 2;"):
        friction_bounds(axis, cascade(limit=2.0), short_move(), COUNT)


@pytest.mark.slow
def test_a_short_move_stays_below_its_bound():
    axis, reference = FlexibleAxis(thesis_axis(), 1e-3), short_move()
    found = friction_bounds(axis, cascade(), reference, COUNT)
    error, control = run(axis, cascade(), reference)
    assert np.all(error <= found.bound) and np.all(control <= found.control)
    assert error.max() > 0.5 * found.bound.max()
