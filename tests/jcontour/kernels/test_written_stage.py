"""A stage written out number by number, with plain numbers, against the readable one."""

import jax
import numpy as np

from jcontour.kernels.written_stage import (
    Sizes,
    choice,
    cost_in_front,
    gain,
    key,
    shape_of,
    weigh,
)
from jcontour.linear.plant import Pattern
from jcontour.riccati.receding_horizon import CostToGo, first_control, one_stage_back


def test_numbers_that_are_zero_are_not_written_out():
    pattern = Pattern.of(np.diag([1.0, 2.0]), np.eye(2), np.array([[0.0, 1.0]]))
    shape = shape_of(pattern)
    assert shape.rows == {0: (0,), 1: (1,), 3: (0,), 4: (1,)} and shape.C == ((0, 1),)
    assert shape.entries == ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2))


def test_one_stage_is_the_readable_one(problems):
    plant = problems.machine((2, 1), 2, 2)
    Q, y_d, _, R, end = problems.data(plant, 1, 1)
    shape, sizes = shape_of(plant.pattern), Sizes(3, 2, 2, 1, 1, True)
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    M = {(i, k): A[i, k] for k in range(3) for i in shape.rows[k]}
    M |= {(i, 4 + u): B[i, u] for u in range(2) for i in shape.rows[4 + u]}
    whole = np.column_stack([end.H[0], end.g[0]])
    behind = {entry: whole[entry] for entry in shape.entries}
    chosen = choice(shape, sizes, M, np.asarray(R).tolist(), behind)
    weighted = np.column_stack([Q[0], -Q[0] @ y_d[0]])
    cost = [weighted[entry] for entry in shape.seen]
    before = cost_in_front(shape, sizes, M, behind, chosen)
    before = weigh(shape, sizes, {entry: C[entry] for entry in shape.C}, before, cost)
    wanted = jax.jit(one_stage_back)(plant, R, CostToGo(*end), Q[:1], y_d[:1])
    plan = jax.jit(first_control)(plant, R, CostToGo(*end))
    K = np.array(gain(shape, sizes, M, chosen.L))
    problems.close((K[:, :3], -K[:, 3]), (np.asarray(plan.F)[0], np.asarray(plan.f)[0]), 1e-12)
    H = np.array([[before[key(i, k)] for k in range(3)] for i in range(3)])
    g = np.array([before[i, 3] for i in range(3)])
    problems.close((H, g), (np.asarray(wanted.H)[0], np.asarray(wanted.g)[0]), 1e-12)
