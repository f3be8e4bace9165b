"""The short sweep against horizons in NumPy, and which of two sweeps is taken."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jcontour.riccati.forgetting as forgetting
from jcontour.controllers.lq.blockwise_lq import BlockwiseLQ
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    RiccatiTerminal,
    contour_weight,
    control_weight,
)
from jcontour.geometry.contours import circle
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.motion.references import along
from jcontour.plants.bridgeport import bridgeport
from jcontour.riccati.receding_horizon import output_cost

STEPS, MEMORY, LENGTH = 7, 4, 3


def problem(plant, steps, seen, scale=1.0):
    random = np.random.default_rng(0)
    roots = random.standard_normal((seen, 2, 2))
    Q, y_d = scale * roots @ roots.mT, random.standard_normal((seen, 2))
    return Q, y_d, 0.3 * np.eye(plant.inputs)


def horizon(plant, Q, y_d, R, k, last):
    """Gains F, f of step k whose horizon ends with the output at sample `last`; A - B F of all."""
    A, B, C = (np.asarray(M) for M in (plant.A, plant.B, plant.C))
    H, g, loops = C.T @ Q[last] @ C, -C.T @ Q[last] @ y_d[last], []
    for j in range(last - 1, k, -1):
        closed = A - B @ np.linalg.solve(B.T @ H @ B + R, B.T @ H @ A)
        g = closed.T @ g - C.T @ Q[j] @ y_d[j]
        H = A.T @ H @ closed + C.T @ Q[j] @ C
        loops.append(closed)
    M = B.T @ H @ B + R
    return np.linalg.solve(M, B.T @ H @ A), -np.linalg.solve(M, B.T @ g), loops


def short(*problem):
    @jax.jit
    def planned(plant, Q, y_d, R):
        def terminal_at(ends):
            return output_cost(plant, Q[ends], y_d[ends])

        return forgetting.short_plan(plant, Q, y_d, R, terminal_at, STEPS, MEMORY, LENGTH)

    return jax.device_get(planned(*problem))


def test_short_sweep_and_its_difference_are_those_of_horizons(coupled_plant, monkeypatch):
    """Blocks of 3 steps behind a run of 7 and 3 more: steps 0 | 1 2 3 | 4 5 6 | 7 8 9."""
    sweep = forgetting.remembering_sweep

    def forgets_all(*arguments):
        F, f, product = sweep(*arguments)
        return F, f, 0.0 * product

    monkeypatch.setattr(forgetting, "remembering_sweep", forgets_all)
    plant = coupled_plant(3, 4, 2)
    Q, y_d, R = problem(plant, STEPS, STEPS + LENGTH + MEMORY)
    found, apart = short(plant, Q, y_d, R)
    numbers = [np.asarray(one) for one in (Q, y_d, R)]
    for k, block_end in enumerate((0, 3, 3, 3, 6, 6, 6)):
        F, f, _ = horizon(plant, *numbers, k, block_end + MEMORY)
        np.testing.assert_allclose(found.F[k], F, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.f[k], f, rtol=1e-9, atol=1e-12)
    near = [horizon(plant, *numbers, k, k + MEMORY) for k in (0, 3, 6)]
    far = [horizon(plant, *numbers, k, k + LENGTH + MEMORY) for k in (0, 3, 6)]
    differences = [
        max(np.abs(one[i] - other[i]).max() for one, other in zip(near, far, strict=True))
        for i in (0, 1)
    ]
    # the largest gain of the run is at most that of all rows, which the block behind it has too
    largest = max(differences[0] / np.abs(found.F).max(), differences[1] / np.abs(found.f).max())
    assert 1e-6 < 0.2 * largest < float(apart) <= (1 + 1e-9) * largest


def test_what_is_remembered_is_the_product_of_the_loops_behind_a_block(coupled_plant, monkeypatch):
    monkeypatch.setattr(forgetting, "_apart", lambda _: jnp.zeros(()))
    plant = coupled_plant(3, 4, 2)
    Q, y_d, R = problem(plant, STEPS, STEPS + LENGTH + MEMORY)
    _, found = short(plant, Q, y_d, R)
    numbers = [np.asarray(one) for one in (Q, y_d, R)]
    loops = [horizon(plant, *numbers, k, k + MEMORY)[2] for k in (0, 3, 6, 9)]
    products = [np.linalg.multi_dot(behind) for behind in loops]
    assert float(found) == pytest.approx(np.abs(products).max(), rel=1e-12)


@given(steps=st.integers(1, 100_000), most=st.integers(1, 2_000))
def test_blocks_are_a_multiple_of_those_swept_at_once(steps, most):
    length = forgetting.block_length(steps, most)
    blocks, groups = -(-(steps + length) // length), -(-(steps + most) // (8 * most))
    assert 1 <= length <= most and blocks <= 8 * groups
    # one step less a block would take more
    assert length == 1 or -(-(steps + length - 1) // (length - 1)) > 8 * groups


@pytest.mark.slow
def test_a_path_that_stands_still_hides_no_memory():
    """The stationary cost behind a horizon, and nothing ahead that moves within two memories."""
    axis = np.array([[1.0, 1e-3], [0.0, 0.9]]), np.array([[0.0], [1.0]])
    A, B = (np.kron(np.eye(2), part) for part in axis)
    plant = LinearPlant(A, B, np.kron(np.eye(2), [[1.0, 0.0]]), dt=1e-3)
    arc = np.concatenate([np.zeros(620), 2.5e-5 * np.arange(800)])
    run = along(circle(5e-3), arc, plant.dt, 1000, at_rest=True).first(10)
    controller = BlockwiseLQ(plant, LQWeights(1.0, 0.0, 10.0), 1000, RiccatiTerminal())
    found = controller.prepare(run)
    with pytest.MonkeyPatch.context() as patch:
        module = "jcontour.controllers.lq.blockwise_lq"
        patch.setattr(f"{module}.suits_forgetting", lambda *_: False)
        wanted = controller.prepare(run)
    np.testing.assert_allclose(found.f, wanted.f, rtol=0, atol=1e-12 * np.abs(wanted.f).max())


@pytest.mark.slow
@pytest.mark.parametrize(("pole", "taken"), [(0.1, True), (0.999, False)])
def test_the_short_sweep_is_taken_where_the_loop_forgets(coupled_plant, monkeypatch, pole, taken):
    """Hardly any feedback: the loop forgets as the plant itself. A plan of NaN says what it is."""
    monkeypatch.setattr(forgetting, "MEMORY", 20)
    plant = coupled_plant(3, 4, 2)
    radius = np.abs(np.linalg.eigvals(plant.A)).max()
    plant = type(plant)(plant.A * (pole / radius), plant.B, plant.C, plant.dt)
    Q, y_d, R = problem(plant, 30, 70, scale=1e-9)

    def whole():
        return AffinePlan(jnp.full((30, 2, 4), jnp.nan), jnp.full((30, 2), jnp.nan))

    def terminal_at(ends):
        return output_cost(plant, Q[ends], y_d[ends])

    found = forgetting.forgetful_plan(plant, Q, y_d, R, terminal_at, whole, 30)
    assert np.isfinite(found.F).all() == np.isfinite(found.f).all() == taken


@pytest.mark.parametrize(("scales", "taken"), [([1.0, 0.5], True), ([1.0, 10.0], False)])
def test_a_batch_takes_the_short_sweep_where_all_members_forget(monkeypatch, scales, taken):
    """One state a axis without a cost: the product of two steps is the square of its pole."""
    monkeypatch.setattr(forgetting, "MEMORY", 3)
    monkeypatch.setattr(forgetting, "FORGOTTEN", 1e-2)

    def plan(scale):
        plant = LinearPlant(0.05 * scale * jnp.eye(2), jnp.eye(2), jnp.eye(2), dt=1e-3)
        Q, y_d = jnp.zeros((11, 2, 2)), jnp.zeros((11, 2))
        whole = AffinePlan(jnp.ones((5, 2, 2)), jnp.ones((5, 2)))
        return forgetting.forgetful_plan(
            plant, Q, y_d, jnp.eye(2), lambda ends: output_cost(plant, Q[ends], y_d[ends]),
            lambda: whole, 5,
        )  # fmt: skip

    found = jax.jit(jax.vmap(plan))(np.array(scales))
    np.testing.assert_array_equal(found.F, np.full((2, 5, 2, 2), 0.0 if taken else 1.0))


def reference(table, preview):
    return along(circle(5e-3), 2.5e-5 * np.arange(600), table.dt, preview, at_rest=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("alpha", "beta", "rho", "forgets"),
    [
        (3.0, 5.0, 2e-9, True),
        (1.2, 20.0, 2e-9, True),
        (100.0, 0.0, 1e-9, True),
        (3.0, 5.0, 1e-12, True),
        (1.0, 5.0, 1e-8, False),
        (0.1, 0.0, 2e-9, False),
        (1.0, 5.0, 1e-6, False),
    ],
)
def test_a_long_preview_has_its_own_gains_whatever_the_weights(alpha, beta, rho, forgets):
    table, weights = bridgeport(), LQWeights(alpha, beta, rho)
    run = reference(table, 1000)
    assert (float(difference(table, weights, run)) <= forgetting.FORGOTTEN) == forgets
    found = plan_of_blocks(table, weights, run)
    if forgets:
        wanted = ContouringLQ(table, weights, 1000).prepare(run)
    else:
        wanted = plan_of_all_blocks(table, weights, run)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * float(jnp.abs(b).max()))


def plan_of_blocks(table, weights, run):
    return jax.jit(lambda run: BlockwiseLQ(table, weights, 1000).prepare(run))(run)


def difference(table, weights, run):
    Q, y_d = contour_weight(weights.alpha, weights.beta, run.tangent), run.position

    def terminal_at(ends):
        return output_cost(table, Q[ends], y_d[ends])

    R = control_weight(table, weights)
    short = forgetting.short_plan(table, Q, y_d, R, terminal_at, run.steps, forgetting.MEMORY, 100)
    return short[1]


def plan_of_all_blocks(table, weights, run):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "jcontour.controllers.lq.blockwise_lq.suits_forgetting", lambda *numbers: False
        )
        return plan_of_blocks(table, weights, run)


@pytest.mark.slow
def test_the_gradient_is_that_of_the_long_horizon():
    table = bridgeport()
    run = reference(table, 1000)

    def slopes(law):
        def value(log):
            plan = law(table, LQWeights(*jnp.exp(log)), 1000).prepare(run)
            return jnp.sum(plan.F**2) + 1e-3 * jnp.sum(jnp.sin(plan.f))

        log = jnp.log(jnp.array([3.0, 5.0, 2e-9]))
        return jax.jit(jax.grad(value))(log), jax.jit(jax.jacfwd(value))(log)

    for found, wanted in zip(slopes(BlockwiseLQ), slopes(ContouringLQ), strict=True):
        scale = float(jnp.abs(wanted).max())
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * scale)
