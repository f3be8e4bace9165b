"""LQ under limits, traced, against the host's MPC of the same problem solved by DAQP."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.frozen_loops import linear_law
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
)
from jcontour.controllers.observers.kalman import OffsetFreeWithLoad, offset_free_gain
from jcontour.geometry.contours import circle, lemniscate, line, polygon
from jcontour.host.loop import reported_loop
from jcontour.host.observed import OffsetFreeHost
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.mpc.tracking import constrained_lq
from jcontour.mpc.tracking.constrained_lq import ConstrainedLQ
from jcontour.mpc.tracking.forms import OffsetFreeForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.plants.actuation import Disturbed
from jcontour.plants.encoders import Encoders
from jcontour.simulation.closed_loop import simulate

N = 6
WEIGHTS = LQWeights(3.0, 50.0, 2e-8)
SQUARE = [[0.0, 0.0], [2e-4, 0.0], [2e-4, 2e-4], [0.0, 2e-4]]
ACTUATOR = Limits.within(control=[0.03, 0.02], increment=0.02)


def shape(name, steps=40):
    k = np.arange(steps)
    return {
        "circle": lambda: along(circle(1e-3), 4e-5 * k, 1e-3, N, at_rest=False),
        "square": lambda: along(polygon(SQUARE), 2e-5 * k, 1e-3, N, at_rest=True),
        "eight": lambda: along(lemniscate(3e-3), 6e-5 * k, 1e-3, N, at_rest=False),
    }[name]()


def host(plant, weights, limits, terminal=None, **given):
    return TrackingMPC(plant, TrackingWeights.of(weights), N, limits, terminal, **given)


run = jax.jit(simulate)


def sizes(plant, weights, reference):
    """Largest values along each axis without limits."""
    free = run(plant, ContouringLQ(plant, weights, N), reference)
    control, output = np.asarray(free.control), np.asarray(free.output)
    speed = np.diff(output, axis=0) / plant.dt
    return {
        "control": np.abs(control).max(axis=0),
        "increment": np.abs(np.diff(control, axis=0)).max(axis=0),
        "speed": np.abs(speed).max(axis=0),
        "acceleration": np.abs(np.diff(speed, axis=0)).max(axis=0) / plant.dt,
    }


def same(actual, wanted, tolerance=1e-6):
    for name in ("control", "output"):
        value, expected = getattr(actual, name), np.asarray(getattr(wanted, name))
        np.testing.assert_allclose(value, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_loops_under_limits_are_those_of_the_host(seed, two_axes):
    """Random weights, limits, profiles and terminals, three contours, with and without a load."""
    random = np.random.default_rng(seed)
    factors = 10.0 ** random.uniform(-1, 1, 3)
    stage = None if seed % 2 else random.uniform(0.5, 2.0, N)
    weights = LQWeights(3.0 * factors[0], 50.0 * factors[1], 2e-8 * factors[2], stage)
    terminal = RiccatiTerminal() if seed % 3 == 0 else OutputTerminal()
    reference = shape(("circle", "square", "eight")[seed % 3])
    free = sizes(two_axes, weights, reference)
    kept = ("control", "increment", "speed")[: 3 if seed % 6 == 1 else 2]  # begun at rest
    limits = Limits.within(**{name: random.uniform(0.6, 0.9) * free[name] for name in kept})
    mpc = host(two_axes, weights, limits, terminal, form=OffsetFreeForm())
    gain = offset_free_gain(two_axes, two_axes.C, 0.05, 0.01, 1e-6)
    behind = OffsetFreeHost(mpc, two_axes, gain, two_axes.C)
    inner = ConstrainedLQ(two_axes, weights, N, limits, terminal)
    controller = OffsetFreeWithLoad(inner, two_axes, gain, two_axes.C)
    load = jnp.full((1, 2), 2e-3 * (seed % 2))
    plant = Encoders(Disturbed(two_axes, load))
    wanted = reported_loop(plant, behind, reference, fallback="soft")
    actual = run(plant, controller, reference)
    # in a step of seed 1 no plan holds the speed. The residual of 1e-6 is then one of the prices,
    # and rounding decides how far the path goes: of 400 loads that differ by 1e-13, 15 % of the
    # runs are 9.3e-4 off
    gives_way = bool(wanted.report.fallback.any())
    assert gives_way == (seed == 1)
    same(actual, wanted.rollout, 2e-3 if gives_way else 1e-6)
    assert wanted.report.active_fraction > 0
    assert int(actual.final_memory.inner.failed) == 0


@pytest.mark.slow
def test_speed_and_acceleration_are_limited_as_on_the_host(two_axes):
    reference = shape("square")
    free = sizes(two_axes, WEIGHTS, reference)
    limits = Limits.within(**{key: 0.8 * free[key] for key in ("speed", "acceleration")})
    wanted = reported_loop(two_axes, host(two_axes, WEIGHTS, limits), reference, fallback="soft")
    actual = run(two_axes, ConstrainedLQ(two_axes, WEIGHTS, N, limits), reference)
    same(actual, wanted.rollout)
    assert wanted.report.active_fraction > 0.1


def test_where_no_limit_acts_it_is_contouring_lq(two_axes):
    reference, far = shape("circle"), Limits.within(control=1e3, increment=1e3)
    wanted = run(two_axes, ContouringLQ(two_axes, WEIGHTS, N), reference)
    actual = run(two_axes, ConstrainedLQ(two_axes, WEIGHTS, N, far), reference)
    same(actual, wanted, 1e-9)


@pytest.mark.slow
def test_slopes_know_that_weights_price_a_limit_that_gives_way(two_axes, monkeypatch):
    """A price so low that a limit on speed is exceeded: the answer moves with its curvature."""
    monkeypatch.setattr(constrained_lq, "PRICE", 0.003)
    reference = shape("circle", 25)
    speed = 0.8 * sizes(two_axes, WEIGHTS, reference)["speed"]

    @jax.jit
    def output(logs):
        weights = LQWeights(*jnp.exp(logs))
        controller = ConstrainedLQ(two_axes, weights, N, Limits.within(speed=speed))
        return simulate(two_axes, controller, reference).output

    def error(logs):
        return jnp.log(jnp.mean((output(logs) - reference.position[:25]) ** 2))

    at = jnp.log(jnp.array([3.0, 50.0, 2e-8]))
    fastest = np.abs(np.diff(output(at), axis=0)).max(axis=0) / two_axes.dt
    assert (fastest > 1.01 * speed).any() and (fastest < 1.24 * speed).any()
    slopes, step = jax.jit(jax.grad(error))(at), 1e-5
    for k in range(3):
        ahead, behind = (float(error(at.at[k].add(size))) for size in (step, -step))
        assert slopes[k] == pytest.approx((ahead - behind) / (2 * step), rel=1e-5, abs=1e-8)


@pytest.mark.slow
def test_margins_are_those_of_the_loop_without_limits(two_axes):
    """At a corner, where the control is at a limit and no longer moves."""
    reference = shape("square")
    limited, free = (
        ConstrainedLQ(two_axes, WEIGHTS, N, ACTUATOR),
        ContouringLQ(two_axes, WEIGHTS, N),
    )
    state = jnp.array([4e-3, 0.0, -4e-3, 0.0])

    def law(controller):
        plan = jax.tree.map(lambda rows: rows[8], controller.prepare(reference))
        memory = controller.initial_memory(reference)
        return linear_law(controller, plan, memory, state)

    plan = jax.tree.map(lambda rows: rows[8], limited.prepare(reference))
    held = eqx.filter_jit(limited.step)(limited.initial_memory(reference), plan, state)[1]
    np.testing.assert_allclose(np.abs(held), [0.02, 0.02], rtol=1e-6)
    (actual, _), (wanted, _) = eqx.filter_jit(law)(limited), eqx.filter_jit(law)(free)
    size = np.abs(wanted.D).max()
    np.testing.assert_allclose(actual.D, wanted.D, rtol=0, atol=1e-9 * size)


def test_a_step_without_an_answer_is_nan_and_is_counted(two_axes):
    controller = ConstrainedLQ(two_axes, WEIGHTS, N, ACTUATOR)
    reference = shape("circle")
    memory = controller.initial_memory(reference)
    plan = jax.device_get(eqx.filter_jit(controller.prepare)(reference))
    plan = jax.tree.map(lambda rows: rows[0], plan)
    after, control = eqx.filter_jit(controller.step)(memory, plan, np.full(4, np.nan))
    assert np.isnan(control).all() and int(after.failed) == 1
    after, control = eqx.filter_jit(controller.step)(memory, plan, np.zeros(4))
    assert np.isfinite(control).all() and int(after.failed) == 0


def test_the_start_is_within_the_limits_and_bad_ones_are_told(two_axes):
    tight = ConstrainedLQ(two_axes, WEIGHTS, N, Limits.within(control=1e-3))
    memory = tight.initial_memory(shape("circle"))
    assert np.abs(memory.control).max() <= 1e-3
    with pytest.raises(ValueError, match="control: needs one bound or one per component"):
        ConstrainedLQ(two_axes, WEIGHTS, N, Limits.within(control=np.ones(3)))


@pytest.mark.slow
def test_a_machine_at_rest_away_from_the_origin_is_no_unsolved_problem():
    """There the slopes of tracking cancel to rounding; slack limits leave the law without limits.

    Two axes of x'' = u begin at rest, 0.3 m from the origin, and then move.
    """
    dt = 1e-3
    A = np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]])
    B = np.kron(np.eye(2), [[dt**2 / 2], [dt]])
    plant = LinearPlant(A, B, np.kron(np.eye(2), [[1.0, 0.0]]), dt)
    path = line([0.123, 0.271], [0.223, 0.371])
    reference = along(path, 2e-5 * np.maximum(np.arange(40) - 15, 0), dt, N, at_rest=True)

    def controls(rho):
        limited = ConstrainedLQ(plant, LQWeights(3.0, 5.0, rho), N, Limits.within(control=50.0))
        rollout = simulate(plant, limited, reference)
        return rollout.control, rollout.final_memory.failed

    free = simulate(plant, ContouringLQ(plant, LQWeights(3.0, 5.0, 1e-7), N), reference).control
    actual, failed = jax.jit(controls)(1e-7)
    assert int(failed) == 0
    np.testing.assert_allclose(actual, free, atol=1e-6 * float(jnp.abs(free).max()))
    slope = jax.jit(jax.jacfwd(lambda rho: controls(rho)[0]))(1e-7)
    assert jnp.isfinite(slope).all()
