"""Governors: no limit is left, whatever the reference is."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from jcontour.controllers.feedback.governor import (
    LoopLimits,
    ScalarGovernor,
    VectorGovernor,
    enough_steps,
    governed_loop,
)
from jcontour.controllers.feedback.state_feedback import lq_gain
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from tests.canonical import DT, plant, reference, round_path

CONTROL, OUTPUT, CENTRE = 0.3, 6e-3, 1e-3
STEPS = 40


@cache
def loop():
    machine = plant(2)
    limits = LoopLimits.of(machine, CONTROL, OUTPUT, CENTRE)
    gain = lq_gain(machine, 1e6 * machine.C.T @ machine.C, jnp.eye(2))
    return governed_loop(machine, gain, limits, enough_steps(machine, gain, limits))


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        (ScalarGovernor, 1000),
        (VectorGovernor, 20),
        pytest.param(ScalarGovernor, 10_000, marks=pytest.mark.slow),
        pytest.param(VectorGovernor, 10_000, marks=pytest.mark.slow),
    ],
)
def test_random_references_leave_no_limit(kind, count):
    """Jumps of up to three times what the limits allow, on the model, after a rest."""
    machine, governor = plant(2), kind(loop())
    random = np.random.default_rng(0)
    wanted = CENTRE + 3 * OUTPUT * random.uniform(-1, 1, (count, STEPS // 8, 2))
    wanted = np.repeat(wanted, 8, axis=1)

    def follow(wanted):
        def step(carry, row):
            state, command = carry
            command, control = governor.step(command, row, state)
            state = machine.step(state, control)
            return (state, command), (control, machine.output(state), command)

        start = machine.initial_state(jnp.full(2, CENTRE), jnp.zeros(2)), jnp.full(2, CENTRE)
        return jax.lax.scan(step, start, wanted)[1]

    control, output, command = jax.jit(jax.vmap(follow))(wanted)
    assert np.abs(control).max() <= CONTROL * (1 + 1e-9)
    assert np.abs(np.asarray(output) - CENTRE).max() <= OUTPUT * (1 + 1e-9)
    assert np.abs(control).max() > 0.9 * CONTROL  # the limits are made use of
    assert np.abs(np.asarray(command) - CENTRE).max() > 0.5 * OUTPUT


def test_the_vector_governor_is_nearest():
    """Against SciPy's sequential quadratic programs."""
    rows, machine = loop(), plant(2)
    state = machine.initial_state(jnp.array([2e-3, -1e-3]), jnp.array([1e-5, -2e-5]))
    before, wanted = jnp.array([2e-3, -1e-3]), jnp.array([2e-2, -1.2e-2])
    actual = np.asarray(VectorGovernor(rows).governed(state, before, wanted))
    G, here = np.asarray(rows.command), np.asarray(rows.state @ state - rows.centre)
    unit = 1e-3

    def inside(v):
        return np.concatenate([1 - here - G @ v * unit, 1 + here + G @ v * unit])

    best = scipy.optimize.minimize(
        lambda v: np.sum((v - np.asarray(wanted) / unit) ** 2),
        np.asarray(before) / unit,
        constraints={"type": "ineq", "fun": inside},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    np.testing.assert_allclose(actual / unit, best.x, rtol=1e-5)
    scalar = np.asarray(ScalarGovernor(rows).governed(state, before, wanted))
    away = np.asarray(wanted - before)
    part = (scalar - np.asarray(before)) / away
    assert part[0] == pytest.approx(part[1], rel=1e-9) and 0 < part[0] < 1
    edge = np.abs(here + G @ scalar).max()
    assert edge == pytest.approx(1.0, rel=1e-9)  # the farthest on its line


def test_a_run_begins_in_steady_motion_and_margins_are_those_of_the_loop():
    """No error from the first sample on; without limits the command is the wanted one."""
    machine, governor = plant(2), ScalarGovernor(loop())
    increment = jnp.array([1e-5, -5e-6])
    way = line(np.zeros(2), np.asarray(400 * increment))
    path = along(way, np.linalg.norm(increment) * np.arange(4), DT, 1, at_rest=False)
    ahead = governor.prepare(path)
    command, state = governor.initial_memory(path), machine.initial_state(jnp.zeros(2), increment)
    np.testing.assert_allclose(command, ahead[0], rtol=1e-9)
    for k in range(3):
        command, control = governor.step(command, ahead[k], state)
        state = machine.step(state, control)
        np.testing.assert_allclose(machine.output(state), (k + 1) * increment, rtol=1e-6)
    far = jnp.array([1.0, 1.0])
    free = governor.without_planned_limits()
    np.testing.assert_array_equal(free.step(command, far, state)[0], far)


def test_what_cannot_be_governed_is_told():
    machine = plant(2)
    with pytest.raises(ValueError, match="all of them are infinite"):
        LoopLimits.of(machine, np.inf)
    limits = LoopLimits.of(machine, CONTROL)
    with pytest.raises(ValueError, match="no command is admissible for ever"):
        enough_steps(machine, -lq_gain(machine, machine.C.T @ machine.C, jnp.eye(2)), limits)
    narrow = governed_loop(machine, jnp.zeros((2, 8)), LoopLimits.of(machine, 1.0, 1e-4), 1)
    with pytest.raises(ValueError, match="cannot rest within its limits"):
        ScalarGovernor(narrow).prepare(reference(round_path(2)))
