"""Predictive position loops against a least-squares problem of a simulated model."""

import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.predictive_cascade import (
    MOVES,
    PredictiveCascade,
    internal_model,
)
from jcontour.sensors import motors
from tests.canonical import DT, STEPS, reference, round_path

LAG, EFFORT, HORIZON, TURN = 5e-3, 1e-4, 8, 0.3


def inner():
    return Cascade(CascadeGains(30.0, 20.0, 0.02, inertia=0.1), motors(2), DT)


def ahead(state, commands):
    """States of the lag under commands, by its exact solution."""
    stays = np.exp(-DT / LAG)
    found = []
    for u in commands:
        y, v = state
        state = y + u * DT + (v - u) * LAG * (1 - stays), u + (v - u) * stays
        found.append(state)
    return np.array(found)


@pytest.mark.parametrize("harmonics", [0, 1])
def test_the_command_is_that_of_a_least_squares_problem(harmonics):
    """The model is simulated; an output error that the internal model knows stays ahead of it."""
    law = PredictiveCascade(inner(), LAG, EFFORT, HORIZON, TURN, harmonics)
    path = reference(round_path(2), preview=HORIZON)
    d, random = law.gains.polynomial.size, np.random.default_rng(0)
    polynomial = np.array([1.0, -1.0])
    if harmonics:
        polynomial = np.convolve(polynomial, [1.0, -2 * np.cos(TURN), 1.0])
    np.testing.assert_allclose(internal_model(TURN, harmonics), polynomial[1:], atol=1e-15)
    commands = 1e-2 * random.standard_normal(d)  # the oldest first
    model = np.concatenate([[[0.0, 0.02]], ahead((0.0, 0.02), commands)])
    k = np.arange(-d, HORIZON + 1)
    error = 1e-4 * np.stack([1.0 + harmonics * np.sin(TURN * k + 1.0), 0.0 * k], axis=1)
    seen = model + error[: d + 1]

    def increments(moves):
        """Commands whose D-filtered values are these moves, none after them."""
        line = list(commands)
        for mu in [*moves, *[0.0] * (HORIZON - len(moves))]:
            line.append(mu - polynomial[1:] @ line[: -d - 1 : -1])
        return np.array(line[d:])

    def outputs(moves):
        return ahead(model[-1], increments(moves))[:, 0] + error[d + 1 :, 0]

    free = outputs(np.zeros(MOVES))
    G = np.stack([outputs(row) - free for row in np.eye(MOVES)], axis=1)
    wanted = np.asarray(path.position)[1 : HORIZON + 1, 0]
    A = np.vstack([G, np.sqrt(EFFORT) * np.eye(MOVES)])
    b = np.concatenate([wanted - free, np.zeros(MOVES)])
    mu = np.linalg.lstsq(A, b, rcond=None)[0][0]
    command = mu - polynomial[1:] @ commands[::-1]

    plan, memory = law.prepare(path), law.initial_memory(path)
    both = np.repeat(seen[:-1][::-1][:, None], 2, axis=1)
    memory = memory._replace(states=both, commands=np.repeat(commands[::-1][:, None], 2, axis=1))
    row = type(plan)(*(leaf_row(one) for one in (plan.command, plan.wanted)))
    position, speed = seen[-1]
    past, _ = law.step(memory, row, (np.full(2, position), np.full(2, speed)))
    assert float(past.commands[0, 0]) == pytest.approx(command, rel=1e-8)


def leaf_row(tree):
    import jax

    return jax.tree.map(lambda leaf: leaf[0], tree)


def test_bad_numbers_are_told():
    for name, lag, effort in (("lag", 0.0, EFFORT), ("effort", LAG, -1.0)):
        with pytest.raises(ValueError, match=name):
            PredictiveCascade(inner(), lag, effort, horizon=8)
    assert STEPS > HORIZON
