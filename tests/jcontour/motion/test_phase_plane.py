"""The two passes against the greatest squares that keep every rule, by a linear program."""

import numpy as np
from scipy.optimize import linprog

from jcontour.motion.phase_plane import sweep


def test_the_passes_find_the_greatest_squares():
    """Rules of a row of steps, all of them linear: their greatest sum is the quickest motion."""
    random = np.random.default_rng(0)
    steps, count = 12, 3
    per_end = random.uniform(0.5, 1.2, (steps, count))
    at_rest = random.uniform(0.1, 0.5, (steps, count))
    gain = random.uniform(0.05, 0.4, (steps, count))
    loss = random.uniform(-0.2, 0.2, (steps, count))
    most = random.uniform(0.2, 2.0, steps + 1)
    most[[0, -1]] = 0.0
    actual = most.copy()
    sweep(np.stack([per_end, at_rest, gain, loss]), actual)
    rows, bounds = [], []
    for i in range(steps):
        for r in range(count):
            row = np.zeros((2, steps + 1))
            row[0, [i, i + 1]] = 1.0, -per_end[i, r]
            row[1, [i + 1, i]] = 1.0, loss[i, r] - 1.0
            rows.append(row)
            bounds.append([at_rest[i, r], gain[i, r]])
    best = linprog(
        -np.ones(steps + 1),
        np.concatenate(rows),
        np.concatenate(bounds),
        bounds=np.stack([0 * most, most], axis=1),
    )
    assert best.status == 0 and (actual < most - 1e-3).any()
    np.testing.assert_allclose(actual, best.x, atol=1e-9)
