"""Every form of the receding-horizon gains against the readable recursion: values and slopes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import contour_weight
from jcontour.linear.plant import LinearPlant
from jcontour.plants import bridgeport
from jcontour.riccati import window_sweep
from jcontour.riccati.decoupled import ContouringProblem, decoupled_plan, suits_decoupled
from jcontour.riccati.receding_horizon import (
    CostToGo,
    blockwise_plan,
    first_control,
    one_stage_back,
    output_cost,
    readable_plan,
    receding_horizon_plan,
)


def judged(problems, form, readable, arguments, tolerance=1e-9):
    """Values of two forms to 1e-11, and the slopes of a scalar of them to `tolerance`."""

    def value(plan_of):
        def scalar(*some):
            plan = plan_of(*some)
            return jnp.sum(jnp.sin(plan.F)) + jnp.sum(jnp.cos(plan.f)), plan

        numbers = tuple(range(len(arguments)))
        return problems.quick(jax.value_and_grad(scalar, numbers, has_aux=True))(*arguments)

    ((_, actual), slopes), ((_, wanted), wanted_slopes) = value(form), value(readable)
    problems.close(actual, wanted, 1e-11)
    problems.close(slopes, wanted_slopes, tolerance)


def contouring(form, plant, preview, weights, tangent, y_d):
    """Plan for weights alpha, beta, rho and the entries of a profile, if any."""
    alpha, beta, rho, *profile = weights
    stage = jnp.stack(profile) if profile else None
    if form == "decoupled":
        problem = ContouringProblem(plant, alpha, beta, rho, stage, tangent, y_d, preview)
        return decoupled_plan(problem)
    stage = jnp.ones(preview) if stage is None else stage
    Q, R = contour_weight(alpha, beta, tangent), rho * jnp.eye(plant.inputs)
    end = output_cost(plant, Q[preview:], y_d[preview:])
    end = CostToGo(stage[-1] * end.H, stage[-1] * end.g)
    return readable_plan(plant, Q, y_d, stage, R, end)


def path(axes, samples):
    random = np.random.default_rng(axes)
    steps = random.standard_normal((samples, axes))
    tangent = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    return jnp.asarray(tangent), jnp.asarray(np.cumsum(tangent, axis=0))


@pytest.mark.parametrize(
    ("sizes", "preview", "profile"),
    [((2, 3, 1), 4, True), ((2,), 3, False), ((3, 2), 1, True)],
)
def test_decoupled_axes_need_no_sweep(problems, sizes, preview, profile):
    plant = problems.machine(sizes, len(sizes), len(sizes))
    assert suits_decoupled(plant.pattern, preview)
    tangent, y_d = path(len(sizes), 7 + preview)
    random = np.random.default_rng(0)
    weights = jnp.asarray(random.uniform(0.5, 2.0, 3 + preview * profile))

    def plan(form):
        def of(weights, tangent, y_d, A, B, C):
            moved = LinearPlant(A, B, C, plant.dt, pattern=plant.pattern)
            return contouring(form, moved, preview, weights, tangent, y_d)

        return of

    def masked(of):
        def inner(weights, tangent, y_d, A, B, C):
            held = zip((A, B, C), plant.pattern, strict=True)
            return of(weights, tangent, y_d, *(M * np.array(where, float) for M, where in held))

        return inner

    arguments = weights, tangent, y_d, plant.A, plant.B, plant.C
    judged(problems, masked(plan("decoupled")), masked(plan("readable")), arguments)


@pytest.mark.parametrize(
    ("alpha", "beta", "rho"), [(3.0, 5.0, 1e-6), (0.0, 15.0, 2e-9), (10, 0, 1e-12)]
)
def test_decoupled_gains_of_the_table_at_extreme_weights(problems, alpha, beta, rho):
    plant, (tangent, y_d) = bridgeport(), path(2, 30)
    actual, wanted = (
        jax.jit(contouring, static_argnums=(0, 2))(
            form, plant, 10, jnp.array([alpha, beta, rho]), tangent, 1e-5 * y_d
        )
        for form in ("decoupled", "readable")
    )
    problems.close(actual, wanted, 1e-10)


def test_coupled_axes_and_long_windows_are_swept(coupled_plant):
    assert not suits_decoupled(coupled_plant(3, 4, 2).pattern, 10)
    assert not suits_decoupled(bridgeport().pattern, 200)


@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "preview"),
    [((3, 2), 2, 2, 4), ((3,), 3, 2, 2), pytest.param((4,), 1, 2, 1, marks=pytest.mark.slow)],
)
def test_the_packed_sweep_is_the_readable_one(problems, sizes, inputs, outputs, preview):
    plant = problems.machine(sizes, inputs, outputs)
    Q, y_d, stage, R, end = problems.data(plant, 6, preview)

    def plan(plan_of):
        def of(Q, y_d, stage, R, H, g):
            Q, R, H = (M + jnp.swapaxes(M, -1, -2) for M in (Q, R, H))
            return plan_of(plant, Q, y_d, stage, R, CostToGo(H, g))

        return of

    judged(problems, plan(receding_horizon_plan), plan(readable_plan), (Q, y_d, stage, R, *end))


def test_blocks_of_time_leave_no_seam(problems, monkeypatch):
    monkeypatch.setattr(window_sweep, "BLOCK", 8)
    plant = problems.machine((4,), 2, 2)
    arguments = problems.data(plant, 27, 4)

    def plan(plan_of):
        return lambda Q, y_d: plan_of(plant, Q + Q.swapaxes(1, 2), y_d, *arguments[2:])

    judged(problems, plan(receding_horizon_plan), plan(readable_plan), arguments[:2])


def test_the_model_may_move_under_the_packed_sweep(problems):
    plant = problems.machine((3,), 2, 2)
    arguments = problems.data(plant, 6, 3)

    def plan(plan_of):
        return lambda A, B, C: plan_of(LinearPlant(A, B, C, 1.0, plant.pattern), *arguments)

    matrices = plant.A, plant.B, plant.C
    judged(problems, plan(receding_horizon_plan), plan(readable_plan), matrices)


def block_by_block(preview, model, Q, y_d, R, terminal):
    """Plan of `blockwise_plan` as the equations say it: every block back from its end."""
    steps, plan = Q.shape[0] - preview, {}
    for block, begin in enumerate(range(steps - preview * len(terminal.H), steps, preview)):
        cost = jax.tree.map(lambda rows, block=block: rows[block : block + 1], terminal)
        for j in reversed(range(2 * preview - 1)):
            k = begin + j
            if j < preview and k >= 0:
                plan[k] = first_control(model, R, cost)
            sample = slice(max(k, 0), max(k, 0) + 1)
            cost = one_stage_back(model, R, cost, Q[sample], y_d[sample])
    rows = [plan[k] for k in range(steps)]
    return jax.tree.map(lambda *each: jnp.concatenate(each), *rows)


@pytest.mark.parametrize(("steps", "preview"), [(7, 3), pytest.param(4, 4, marks=pytest.mark.slow)])
def test_blocks_are_the_readable_ones(problems, steps, preview):
    plant = problems.machine((2, 1), 2, 2)
    Q, y_d, _, R, end = problems.data(plant, steps, preview)
    count = -(-steps // preview)

    def plan(form):
        def of(Q, y_d, R, H, g):
            Q, R, H = (M + jnp.swapaxes(M, -1, -2) for M in (Q, R, H))
            end = CostToGo(H, g)
            if form == "packed":
                return blockwise_plan(plant, Q, y_d, R, end, preview)
            return block_by_block(preview, plant, Q, y_d, R, end)

        return of

    arguments = Q, y_d, R, end.H[:count], end.g[:count]
    judged(problems, plan("packed"), plan("readable"), arguments)


def test_single_precision_stays_single(problems):
    plant, (tangent, y_d) = bridgeport(), path(2, 30)
    weights = jnp.array([3.0, 5.0, 1e-6])
    numbers = plant, weights, tangent, 1e-5 * y_d

    def plan(plant, weights, tangent, y_d):
        return contouring("decoupled", plant, 10, weights, tangent, y_d)

    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), numbers)
    actual = jax.jit(plan)(*single)
    assert actual.F.dtype == actual.f.dtype == jnp.float32
    problems.close(actual, jax.jit(plan)(*numbers), 1e-3)
