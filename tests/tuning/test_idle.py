"""Weights without effect, beside one that has some, on an integrator."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controller import Controller
from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_plants, stack_references
from tuning import idle
from tuning.idle import put_back, without_slope
from tuning.objectives import AtMost, mean_tracking_error
from tuning.parameters import Positive
from tuning.problem import Problem

START = {"gain": jnp.asarray(0.3), "late": jnp.asarray(2.0), "spare": jnp.asarray([5.0, 6.0])}
FOUND = {"gain": jnp.asarray(0.5), "late": jnp.asarray(3.0), "spare": jnp.asarray([900.0, 0.1])}
REFERENCE = along(line(np.zeros(1), np.full(1, 3e-3)), 1e-4 * np.arange(30), 1e-3, 0, at_rest=False)


class Follower(Controller):
    """u = k (y_d - x), with a factor that acts above 4 only."""

    gain: Any
    late: Any
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return None, self.gain * jnp.maximum(self.late, 4.0) / 4.0 * (plan - measurement)


PROBLEM = Problem(
    lambda weights: Follower(weights["gain"], weights["late"]),
    stack_plants([LinearPlant([[1.0]], [[1.0]], [[1.0]], 1e-3)]),
    stack_references([REFERENCE]),
    mean_tracking_error,
    dict.fromkeys(START, Positive()),
    AtMost(rms_control=1.0),
)
ALL = np.ones(4, bool)


def test_what_has_no_effect_is_put_back():
    weights, none = put_back(PROBLEM, START, FOUND, ALL)
    assert none.tolist() == [False, True, True, True]
    assert float(weights["gain"]) == pytest.approx(0.5)
    assert float(weights["late"]) == pytest.approx(2.0)
    np.testing.assert_allclose(weights["spare"], [5.0, 6.0])


def test_a_weight_that_acts_at_the_start_is_none():
    begun = {**START, "late": jnp.asarray(4.5)}
    weights, none = put_back(PROBLEM, begun, FOUND, ALL)
    assert none.tolist() == [False, False, True, True]
    assert float(weights["late"]) == pytest.approx(3.0)


def test_nothing_is_looked_at_where_everything_has_a_slope():
    weights, none = put_back(PROBLEM, START, FOUND, np.zeros(4, bool))
    assert weights is FOUND and not none.any()


def test_no_slope_of_errors_and_limits():
    errors, limits = np.zeros((1, 2, 3)), np.zeros((1, 3))
    errors[0, 1, 0], limits[0, 2] = 1e-30, -1.0
    assert idle._flat(errors, limits).tolist() == [False, True, False]
    assert without_slope(None).size == 0
