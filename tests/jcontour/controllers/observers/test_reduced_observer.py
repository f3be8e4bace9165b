import json
from functools import cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controller import Controller
from jcontour.controllers.observers.disturbance_observer import (
    ReducedObserver,
    augmented_model,
    error_matrix,
    thesis_gain,
)
from jcontour.linear.plant import AffinePlan
from jcontour.motion.point_to_point import thesis_task_a
from jcontour.plants.encoders import Sensed
from jcontour.plants.flexible_axis.axis import euler_model, thesis_axis, zoh_model
from jcontour.simulation.closed_loop import simulate

DATA = json.loads((Path(__file__).parents[3] / "data" / "single_axis" / "models.json").read_text())
DT = 1e-3


class Swinging(Controller):
    """u = f - F x, the same at every step."""

    F: np.ndarray
    preview: int = 1

    def prepare(self, reference):
        return AffinePlan(
            jnp.zeros((reference.steps, 1, 4)), 2.0 * jnp.sin(jnp.arange(reference.steps))[:, None]
        )

    def initial_memory(self, reference):
        return jnp.zeros((0,))

    def step(self, memory, plan, measurement):
        return memory, plan.f - self.F @ measurement


@cache
def inner():
    return Swinging(np.array([[2e3, 30.0, -1.9e3, 1.0]]))


@pytest.mark.parametrize(("name", "make"), [("euler", euler_model), ("zoh", zoh_model)])
def test_thesis_observer(name, make):
    """The printed gain: stable with the exact model, not with the printed one."""
    model, wanted = make(thesis_axis(), DT), DATA[name]
    moduli = np.sort(np.abs(np.linalg.eigvals(error_matrix(model, thesis_gain()))))
    np.testing.assert_allclose(moduli, wanted["abs_eig_Lambda"], rtol=0, atol=1e-12)
    if name == "euler":
        augmented = augmented_model(model, thesis_gain())
        for found, key in (
            (augmented.A, "A_aug"),
            (np.asarray(augmented.B)[:, 0], "B_aug"),
            (augmented.C, "C_aug"),
        ):
            np.testing.assert_allclose(found, wanted[key], rtol=0, atol=1e-12)
        with pytest.raises(
            ValueError,
            match=r"gain: the observer is not stable: .* they are \[0\.99.*\+0\.0\d+j 0\.99.*\]",
        ):
            ReducedObserver(inner(), model, thesis_gain())


@pytest.fixture(scope="module")
def machine(thesis_model):
    """The model as a machine that measures its motor."""
    return Sensed(thesis_model, lambda x: (x[:1], x[1:2]))


def test_estimation_error_obeys_lambda_under_any_control(machine, thesis_model):
    task = thesis_task_a()
    off = np.array([1e-3, -0.02])
    begin = thesis_model.initial_state(np.asarray(task.position)[0], task.start_increment)
    start = np.asarray(begin) + np.concatenate([[0, 0], off])
    run = simulate(machine, ReducedObserver(inner(), thesis_model, thesis_gain()), task, start)
    states = np.asarray(run.state)
    estimate = np.asarray(run.memory.z) + states[:, :2] @ thesis_gain().T
    assert np.abs(states).max() > 1e-2
    Lambda = np.asarray(error_matrix(thesis_model, thesis_gain()))
    for k in (0, 1, 7, 400):
        np.testing.assert_allclose(
            states[k, 2:] - estimate[k], np.linalg.matrix_power(Lambda, k) @ off, rtol=0, atol=1e-12
        )


def test_a_perfect_start_is_state_feedback(machine, thesis_model):
    task = thesis_task_a()
    found = simulate(machine, ReducedObserver(inner(), thesis_model, thesis_gain()), task)
    wanted = simulate(thesis_model, inner(), task)
    np.testing.assert_allclose(
        found.control, wanted.control, rtol=0, atol=1e-8 * np.abs(wanted.control).max()
    )


def test_bad_gains_are_named(thesis_model):
    with pytest.raises(ValueError, match="^gain: needs shape"):
        ReducedObserver(inner(), thesis_model, np.zeros((2, 1)))
    with pytest.raises(ValueError, match="^gain: the observer is not stable"):
        ReducedObserver(inner(), thesis_model, np.array([[0.0, -1.0], [0.0, -1.0]]))
