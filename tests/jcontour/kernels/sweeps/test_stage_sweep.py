"""The sweep of eight windows at a time against the one in XLA and the readable one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels.packed_stage import cost_entries, stage_maps
from jcontour.kernels.packing import packing
from jcontour.kernels.sweeps import window_sweep
from jcontour.kernels.sweeps.stage_sweep import stage_sweep, suits_stages
from jcontour.kernels.sweeps.window_sweep import SweepData
from jcontour.linear.plant import LinearPlant
from jcontour.plants import bridgeport
from jcontour.riccati.receding_horizon import CostToGo, first_control, one_stage_back


def problem(plant: LinearPlant, steps: int, preview: int) -> SweepData:
    random = np.random.default_rng(1)

    def positive(*shape):
        root = random.standard_normal((*shape, shape[-1]))
        return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(shape[-1])

    Q, y_d = positive(steps + preview, plant.axes), random.standard_normal((steps + preview, 2))
    return SweepData(
        jax.jit(cost_entries)(Q, y_d),
        random.uniform(0.5, 2.0, preview),
        positive(plant.inputs),
        positive(steps, plant.states),
        random.standard_normal((steps, plant.states)),
    )


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.max(np.abs(wanted)))


@pytest.mark.slow
@pytest.mark.parametrize(("steps", "preview"), [(21, 4), (3, 2), (9, 1)])
def test_all_gains_of_sliding_windows_are_those_of_xla(steps, preview, coupled_plant):
    for plant in (bridgeport(), coupled_plant(0, 3, 2)):
        data = problem(plant, steps, preview)
        model = plant.A, plant.B, plant.C
        assert suits_stages(plant.pattern, *model, data)
        found = jax.jit(window_sweep._gains, static_argnums=(0, 1))(
            plant.pattern, True, *model, data
        )
        wanted = jax.jit(
            lambda data, plant=plant, model=model: window_sweep._sweep(
                plant.pattern, stage_maps(plant.pattern, *model), data
            )
        )(data)
        assert found.later.shape == wanted.later.shape
        close(found.first, wanted.first)
        close(found.G, wanted.G)
        for one, other in zip(found.later, wanted.later, strict=True):
            close(one, other)


def test_windows_with_samples_of_their_own_are_the_equations(coupled_plant):
    plant, stages, windows, kept = coupled_plant(1, 3, 2), 4, 11, 2
    data = problem(plant, windows, stages)
    random = np.random.default_rng(2)
    root = random.standard_normal((stages - 1, windows, 2, 2))
    Q, y_d = root @ root.mT, random.standard_normal(root.shape[:3])
    cost = jax.jit(jax.vmap(cost_entries, out_axes=1))(Q, y_d)
    scale = data.stage[:-1]
    sweep = jax.jit(stage_sweep, static_argnums=(0, 9, 10))
    model = plant.pattern, plant.A, plant.B, plant.C
    K, G, product = jax.device_get(sweep(*model, data.R, cost, scale, data.H, data.g, kept, True))
    remembered = np.broadcast_to(np.eye(3), (windows, 3, 3))
    behind, order = CostToGo(data.H, data.g), packing(plant.pattern).order
    A, B = np.asarray(plant.A), np.asarray(plant.B)
    for s in reversed(range(stages)):
        plan = jax.device_get(jax.jit(first_control)(plant, data.R, behind))
        if s >= kept:
            remembered = remembered @ (A - B @ plan.F)
        else:
            close(np.moveaxis(K[s, :, :3], -1, 0), plan.F[:, :, order])
            close(-K[s, :, 3].T, plan.f)
        if s == 0:
            inverse = np.linalg.inv(B.T @ behind.H @ B + data.R)
            close(np.moveaxis(G, -1, 0), inverse)
            close(np.moveaxis(product, -1, 0), remembered)
            break
        behind = jax.device_get(
            jax.jit(one_stage_back)(plant, data.R, behind, scale[s - 1] * Q[s - 1], y_d[s - 1])
        )


def test_single_precision_and_large_plants_are_left_to_xla(coupled_plant):
    plant = bridgeport()
    assert not suits_stages(plant.pattern, np.zeros(1, np.float32))
    assert not suits_stages(coupled_plant(0, 12, 3).pattern, plant.A)


@pytest.mark.slow
def test_second_derivatives_are_those_of_the_sweep_in_xla(monkeypatch):
    plant = bridgeport()
    data = problem(plant, 9, 3)

    def value(weights):
        moved = data._replace(cost=weights[0] * data.cost, R=weights[1] * data.R)
        plan = window_sweep._plan(plant.pattern, plant.A, plant.B, plant.C, moved)
        return sum(jnp.sum(jnp.sin(rows)) for rows in plan)

    found = jax.jit(jax.hessian(value))(np.array([1.1, 0.9]))
    monkeypatch.setattr(window_sweep, "suits_stages", lambda *_: False)
    wanted = jax.jit(jax.hessian(lambda weights: value(weights)))(np.array([1.1, 0.9]))
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
