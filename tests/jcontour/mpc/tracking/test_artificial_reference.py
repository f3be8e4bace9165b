"""Tracking MPC with an artificial reference: any reference is feasible, no limit is broken."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.frozen_loops import linear_law
from jcontour.controllers.feedback.governor import LoopLimits, enough_steps
from jcontour.controllers.feedback.state_feedback import lq_gain
from jcontour.mpc.tracking.artificial_reference import ArtificialMemory, ArtificialReferenceMPC
from jcontour.qp.problem import QP
from jcontour.qp.solvers import DAQP
from tests.canonical import plant

CONTROL, OUTPUT, HORIZON = 0.3, 6e-3, 4
STEPS, FAR = 16, jnp.full((HORIZON, 1), 2e-2)  # [m]: the control meets its limit


@cache
def law(axes=1):
    machine = plant(axes)
    Q, R = 1e6 * machine.C.T @ machine.C, jnp.eye(axes)
    limits = LoopLimits.of(machine, CONTROL, OUTPUT)
    steps = enough_steps(machine, lq_gain(machine, Q, R), limits)
    return ArtificialReferenceMPC(machine, Q, R, 1e7, limits, HORIZON, steps)


@pytest.mark.parametrize(
    "count", [20, pytest.param(10_000, marks=[pytest.mark.slow, pytest.mark.optimised])]
)
def test_random_references_are_feasible_and_leave_no_limit(count):
    machine, controller = plant(1), law()
    random = np.random.default_rng(0)
    wanted = np.repeat(3 * OUTPUT * random.uniform(-1, 1, (count, STEPS // 8)), 8, axis=1)
    wanted = np.broadcast_to(wanted[:, :, None, None], (count, STEPS, HORIZON, 1))

    def follow(wanted):
        def step(carry, row):
            state, memory = carry
            memory, control = controller.step(memory, row, state)
            state = machine.step(state, control)
            return (state, memory), (control, machine.output(state), memory.failed)

        start = machine.initial_state(jnp.zeros(1), jnp.zeros(1))
        memory = ArtificialMemory(jnp.zeros(1), jnp.zeros((), int))
        return jax.lax.scan(step, (start, memory), wanted)[1]

    control, output, failed = jax.jit(jax.vmap(follow))(np.array(wanted))
    assert int(np.asarray(failed)[:, -1].max()) == 0
    assert np.abs(control).max() <= CONTROL * (1 + 1e-6)
    assert np.abs(output).max() <= OUTPUT * (1 + 1e-6)
    assert np.abs(control).max() > 0.9 * CONTROL and np.abs(output).max() > 0.02 * OUTPUT


def test_a_plan_is_that_of_another_solver():
    """The states eliminated, by the dual active-set solver on the host."""
    controller, machine = law(), plant(1)
    state = machine.initial_state(jnp.array([1e-3]), jnp.array([1e-4]))
    memory = ArtificialMemory(jnp.array([1e-3]), jnp.zeros((), int))
    qp = controller.problem(memory, FAR, state)
    actual = np.asarray(controller.answer(memory, FAR, state).trajectory.stages)
    A, B, x0 = (np.asarray(one) for one in (qp.A, qp.B, qp.x0))
    n, p, N = len(A), B.shape[1], HORIZON
    S, T = [np.eye(n)], [np.zeros((n, N * p))]
    for j in range(N):
        S.append(A @ S[-1])
        moved = A @ T[-1]
        moved[:, j * p : (j + 1) * p] += B
        T.append(moved)
    H, g = np.zeros((N * p, N * p)), np.zeros(N * p)
    rows, low, high = [], [], []
    for j in range(N):
        V = np.vstack([T[j], np.eye(N * p)[j * p : (j + 1) * p]])
        v = np.concatenate([S[j] @ x0, np.zeros(p)])
        H += V.T @ np.asarray(qp.H[j]) @ V
        g += V.T @ (np.asarray(qp.H[j]) @ v + np.asarray(qp.h[j]))
        acting = np.isfinite(np.asarray(qp.upper[j]))
        D = np.asarray(qp.D)[acting]
        rows.append(D @ V)
        low.append(np.asarray(qp.lower[j])[acting] - D @ v)
        high.append(np.asarray(qp.upper[j])[acting] - D @ v)
    H += T[N].T @ np.asarray(qp.H_end) @ T[N]
    g += T[N].T @ (np.asarray(qp.H_end) @ S[N] @ x0 + np.asarray(qp.h_end))
    free = np.full(N * p, np.inf)
    constraints = (np.concatenate(one) for one in (rows, low, high))
    solved = DAQP().solve(QP(H, g, *constraints, -free, free))
    other = solved.z.reshape(N, p)
    np.testing.assert_allclose(actual[:, n:], other, rtol=1e-5, atol=1e-7 * np.abs(other).max())
    assert np.abs(other[:, 0]).max() > 0.9 * CONTROL


def test_a_frozen_loop_is_that_of_the_plan_without_limits():
    controller, memory = law(), ArtificialMemory(jnp.zeros(1), jnp.zeros((), int))
    rest = jnp.zeros(plant(1).states)
    at_limit, calm = (linear_law(controller, row, memory, rest)[0] for row in (FAR, 0.0 * FAR))
    jax.tree.map(partial(np.testing.assert_allclose, rtol=1e-6, atol=1e-9), at_limit, calm)
    assert np.abs(calm.D).min() > 0.1


def test_too_few_steps_are_refused():
    machine = plant(1)
    Q, limits = 1e6 * machine.C.T @ machine.C, LoopLimits.of(machine, CONTROL, OUTPUT)
    with pytest.raises(ValueError, match="too few for the end of the horizon"):
        ArtificialReferenceMPC(machine, Q, jnp.eye(1), 1e7, limits, HORIZON, 1)
