"""The kernels of the closed loop with a batch behind time.

`test_lane_score` asks for values and derivatives.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels.gpu.lanes import Operand
from jcontour.kernels.gpu.loop_lanes import cotangents, runs, times, transposed


def case(problems, steps=4, members=3):
    plant, random = problems.machine((2, 1), 2, 2), np.random.default_rng(3)
    F, f, start = (
        jnp.asarray(0.3 * random.standard_normal(shape))
        for shape in ((2, 3, steps, members), (2, steps), (3, members))
    )
    model = [Operand(M) for M in (plant.A, plant.B, plant.C)]
    return plant, model, Operand(F, (0,)), Operand(f), Operand(start, (0,))


@pytest.mark.slow
def test_runs_of_several_members(problems):
    plant, model, F, f, start = case(problems)
    y, u, x = runs(plant.pattern, (*model, F, f, start), True)
    for k in range(3):
        state = start.array[:, k]
        for t in range(4):
            control = f.array[:, t] - F.array[:, :, t, k] @ state
            np.testing.assert_allclose(x[:, t, k], state, rtol=1e-12, atol=1e-15)
            np.testing.assert_allclose(u[:, t, k], control, rtol=1e-12, atol=1e-15)
            np.testing.assert_allclose(y[:, t, k], plant.C @ state, rtol=1e-12, atol=1e-15)
            state = plant.A @ state + plant.B @ control


@pytest.mark.slow
def test_a_change_of_the_first_state_and_of_the_plan_is_felt_as_its_cotangent_says(problems):
    plant, model, F, f, start = case(problems, members=2)
    random = np.random.default_rng(4)
    _, _, x = runs(plant.pattern, (*model, F, f, start), True)
    bars = [jnp.asarray(random.standard_normal((2, 4, 2))) for _ in range(2)]
    found = cotangents(
        plant.pattern, (*model, F, Operand(x, (0,)), *(Operand(bar, (0,)) for bar in bars))
    )
    change = [
        jnp.asarray(random.standard_normal(array.shape))
        for array in (F.array, f.array, start.array)
    ]

    def value(scale):
        moved = [
            Operand(one.array + scale * move, one.axes)
            for one, move in zip((F, f, start), change, strict=True)
        ]
        return sum(
            float(jnp.vdot(bar, signal))
            for bar, signal in zip(bars, runs(plant.pattern, (*model, *moved), False), strict=True)
        )

    felt = (
        jnp.vdot(found[0], change[0])
        + jnp.vdot(jnp.sum(found[1], -1), change[1])
        + jnp.vdot(found[2], change[2])
    )
    assert float(felt) == pytest.approx((value(1e-5) - value(-1e-5)) / 2e-5, rel=1e-8)


def test_sparse_products():
    M = {(0, 1): 2.0, (1, 0): 3.0}
    assert times(M, [5.0, 7.0], 3) == [14.0, 15.0, 0.0]
    assert transposed(M) == {(1, 0): 2.0, (0, 1): 3.0}
