"""Generalised predictive control against a least-squares problem of a simulated model."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.predictive import MOVES, PredictiveCascade
from jcontour.sensors import motors
from tests.canonical import DT, reference, round_path

LAG, EFFORT, HORIZON = 5e-3, 1e-4, 8
LOOPS = Cascade(CascadeGains(30.0, 20.0, 0.02, inertia=0.1), motors(2), DT)


def ahead(state, commands):
    """States of the lag under commands, by its exact solution."""
    stays = np.exp(-DT / LAG)
    found = []
    for u in commands:
        y, v = state
        state = y + u * DT + (v - u) * LAG * (1 - stays), u + (v - u) * stays
        found.append(state)
    return np.array(found)


def test_the_command_is_that_of_a_least_squares_problem():
    """The model is simulated; a constant error of its output stays ahead of it."""
    law, path = PredictiveCascade(LOOPS, LAG, EFFORT, HORIZON), reference(round_path(2), preview=8)
    before, last, error = (2e-3, 0.02), 0.03, np.array([1e-4, 0.0])
    now = ahead(before, [last])[0]

    def outputs(moves):
        later = np.concatenate([moves, np.zeros(HORIZON - len(moves))])
        return ahead(now, last + np.cumsum(later))[:, 0] + error[0]

    free = outputs(np.zeros(MOVES))
    G = np.stack([outputs(row) - free for row in np.eye(MOVES)], axis=1)
    wanted = np.asarray(path.position)[1 : HORIZON + 1, 0]
    A = np.vstack([G, np.sqrt(EFFORT) * np.eye(MOVES)])
    mu = np.linalg.lstsq(A, np.concatenate([wanted - free, np.zeros(MOVES)]), rcond=None)[0][0]

    state = np.tile(np.array(before) + error, (2, 1))
    start = law.initial_memory(path)
    memory = start._replace(state=jnp.asarray(state), command=jnp.full(2, last))
    row = jax.tree.map(lambda leaf: leaf[0], law.prepare(path))
    position, speed = now + error
    past, _ = law.step(memory, row, (np.full(2, position), np.full(2, speed)))
    assert float(past.command[0]) == pytest.approx(last + mu, rel=1e-8)


def test_bad_numbers_are_told():
    for name, lag, effort in (("lag", 0.0, EFFORT), ("effort", LAG, -1.0)):
        with pytest.raises(ValueError, match=name):
            PredictiveCascade(LOOPS, lag, effort, horizon=8)
