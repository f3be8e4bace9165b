"""Gains from a change of the weight against the readable sweep of the whole weight.

Without a GPU the kernels are interpreted, so the cases are tiny.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.arrays import placed
from jcontour.controllers.lq.contouring_lq import contour_weight
from jcontour.kernels.gpu.rank_one_lanes import (
    lanes_of,
    owners,
    programs_of,
    rank_one_gains,
    solved,
)
from jcontour.linear.plant import AffinePlan, Pattern
from jcontour.riccati.receding_horizon import CostToGo, output_cost, readable_plan


def window(outputs: int, steps: int, preview: int):
    random = np.random.default_rng(2)
    tangent = random.standard_normal((steps + preview, outputs))
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    stage = random.uniform(0.5, 1.5, preview)
    return tangent, 0.3 + np.cumsum(tangent, axis=0), stage


def readable(plant, alpha, beta, tangent, y_d, stage, R) -> AffinePlan:
    Q, preview = contour_weight(alpha, beta, tangent), stage.shape[0]
    end = output_cost(plant, Q[preview:], y_d[preview:])
    return readable_plan(plant, Q, y_d, stage, R, CostToGo(stage[-1] * end.H, stage[-1] * end.g))


@pytest.mark.parametrize(
    ("sizes", "inputs", "steps", "preview"),
    [
        ((1,), 1, 3, 1),
        pytest.param((2, 2), 2, 5, 4, marks=pytest.mark.slow),
        pytest.param((2, 1, 2), 3, 19, 3, marks=pytest.mark.slow),
        pytest.param((3, 2), 3, 2, 5, marks=pytest.mark.slow),  # an axis with two inputs
    ],
)
def test_equals_the_readable_sweep(problems, sizes, inputs, steps, preview):
    plant = problems.machine(sizes, inputs, len(sizes))
    tangent, y_d, stage = window(len(sizes), steps, preview)
    weights = np.array([[1.0, 2.0, 0.1], [0.1, 5.0, 0.3], [0.0, 1.0, 0.2], [2.0, 0.0, 0.5]])

    def lanes(alpha, beta, rho):
        model, R = (plant.pattern, plant.A, plant.B, plant.C), rho * jnp.eye(inputs)
        return rank_one_gains(*model, alpha + beta, beta, tangent, y_d, stage, R)

    def sweep(alpha, beta, rho):
        samples = map(placed, (tangent, y_d, stage))
        plan = readable(plant, alpha, beta, *samples, rho * jnp.eye(inputs))
        return plan.F, plan.f

    found, wanted = (jax.jit(jax.vmap(gains))(*weights.T) for gains in (lanes, sweep))
    problems.close(found, wanted, 1e-11)


@pytest.mark.parametrize(("steps", "members"), [(1, 1), (20, 3), (33, 11), (500, 8)])
def test_every_step_of_every_member_has_a_lane(steps, members):
    seen = set()
    for program in range(programs_of(steps, members)):
        lanes = lanes_of(program, steps, members)
        np.testing.assert_array_equal(lanes.number, lanes.step * members + lanes.member)
        seen |= set(np.asarray(lanes.number).tolist())
    assert seen == set(range(steps * members))


def test_owners_of_states_and_inputs():
    A, B, C = np.eye(3), np.array([[0.0, 1], [1, 0], [1, 0]]), np.array([[1.0, 0, 0], [0, 1, 1]])
    found = owners(Pattern.of(A, B, C))
    assert found.states == {0: 0, 1: 1, 2: 1} and found.inputs == {0: 1, 1: 0}


def test_solutions_of_several_right_hand_sides():
    random = np.random.default_rng(0)
    root = random.standard_normal((5, 5))
    S, right = root @ root.T + np.eye(5), random.standard_normal((2, 5))
    found = solved(lambda i, j: jnp.asarray(S[i, j]), list(map(list, jnp.asarray(right))))
    np.testing.assert_allclose(np.array(found), np.linalg.solve(S, right.T).T, atol=1e-13)
