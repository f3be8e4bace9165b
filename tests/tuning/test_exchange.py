"""Exchange of probes under a gain that doubles on a few samples, in closed form: see `bumped`.

Weights without effect, beside one that has some, on an integrator.
"""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_plants, stack_references
from tests.small_loops import OnPositions
from tests.tuning import bumped
from tests.tuning.bumped import HIGH
from tuning import exchange
from tuning.exchange import STABLE, exchanged, put_back, without_slope
from tuning.loops import ProbedLoops
from tuning.objectives import AtMost, mean_tracking_error, no_limits
from tuning.parameters import Interval, Positive
from tuning.problem import THOROUGH, Problem
from tuning.tuner import tune

FEW, MANY = 4, 64
SAMPLES = (30, 31)  # between the probes that a search begins with
START = {"gain": jnp.asarray(0.4)}
EFFORT = replace(THOROUGH, starts=1, scatter=0)


def problem_of(limits=no_limits, high=HIGH, looks=False):
    return bumped.problem_of(SAMPLES, limits, high, FEW if looks else None)


def probes(problem):
    assert isinstance(problem.loops, ProbedLoops)
    return problem.loops.windows.position.shape[0]


def names(problem):
    assert isinstance(problem.limits, AtMost)
    return problem.limits.names


def searched(problem, rounds=3):
    """Gains after every round."""
    tuned = tune(problem, START, EFFORT)
    gains = [float(tuned.weights["gain"])]
    for _ in range(rounds):
        more = exchanged(problem, START, tuned, FEW, MANY)
        if more is None:
            return gains, problem
        problem = more.problem
        tuned = tune(problem, tuned.weights, EFFORT)
        gains.append(float(tuned.weights["gain"]))
    raise AssertionError(f"no end: {gains}")


@pytest.mark.slow
def test_a_loop_unstable_or_beyond_its_limit_between_the_probes_is_found_and_led_back():
    gains, problem = searched(problem_of())
    assert abs(1 - HIGH * gains[0]) > 1  # what the search alone ends in
    assert abs(1 - HIGH * gains[-1]) < 1
    assert gains[-1] == pytest.approx((1 + STABLE) / HIGH, rel=1e-4)  # where the limit holds it
    assert probes(problem) > FEW
    gains, problem = searched(problem_of(AtMost(peak_sensitivity=2.0), looks=True))
    assert gains[0] == pytest.approx(1.0, rel=1e-4)  # Ms = 2 where the gain is not doubled
    assert gains[-1] == pytest.approx(1 / HIGH, rel=1e-4)
    assert names(problem) == ("peak_sensitivity",)


def test_limits_that_were_there_stay():
    problem = problem_of(AtMost(rms_control=1.0))
    more = exchanged(problem, START, tune(problem, START, EFFORT), FEW, MANY)
    assert more is not None and more.unstable and more.added == 1
    assert names(more.problem) == ("rms_control", "spectral_radius")


@pytest.mark.slow
def test_nothing_is_exchanged_where_no_loop_is_worse():
    gains, problem = searched(problem_of(AtMost(peak_sensitivity=2.0), high=1.0, looks=True))
    assert len(gains) == 1 and probes(problem) == FEW
    within = problem_of(AtMost(peak_sensitivity=2.0), high=1.005, looks=True)
    assert len(searched(within)[0]) == 1  # Ms is 2.010 between the probes


def test_a_loop_that_is_worse_than_those_seen_but_within_its_limit_is_left_out():
    problem = problem_of(AtMost(peak_sensitivity=5.0), high=1.1, looks=True)
    problem = replace(problem, space={"gain": Interval(0.1, 1.0)})
    tuned = tune(problem, START, EFFORT)
    seen, between = (2 / (2 - high * float(tuned.weights["gain"])) for high in (1.0, 1.1))
    assert 1.02 * seen < between < 5.0  # Ms
    assert exchanged(problem, START, tuned, FEW, MANY) is None


def test_what_cannot_be_exchanged_is_refused(proportional_problem, loop_peaks):
    problem = problem_of(AtMost(peak_sensitivity=2.0), high=1.0, looks=True)
    tuned = tune(problem, START, EFFORT)
    with pytest.raises(ValueError, match="many.*multiple of 4"):
        exchanged(problem, START, tuned, FEW, 10)
    other = proportional_problem(loops=loop_peaks)
    with pytest.raises(ValueError, match="loops.*probed"):
        exchanged(other, START, tuned, FEW, MANY)


IDLE_START = {"gain": jnp.asarray(0.3), "late": jnp.asarray(2.0), "spare": jnp.asarray([5.0, 6.0])}
FOUND = {"gain": jnp.asarray(0.5), "late": jnp.asarray(3.0), "spare": jnp.asarray([900.0, 0.1])}
REFERENCE = along(line(np.zeros(1), np.full(1, 3e-3)), 1e-4 * np.arange(30), 1e-3, 0, at_rest=False)


class Follower(OnPositions):
    """u = k (y_d - x), with a factor that acts above 4 only."""

    gain: Any
    late: Any

    def step(self, memory, plan, measurement):
        return None, self.gain * jnp.maximum(self.late, 4.0) / 4.0 * (plan - measurement)


PROBLEM = Problem(
    lambda weights: Follower(weights["gain"], weights["late"]),
    stack_plants([LinearPlant([[1.0]], [[1.0]], [[1.0]], 1e-3)]),
    stack_references([REFERENCE]),
    mean_tracking_error,
    dict.fromkeys(IDLE_START, Positive()),
    AtMost(rms_control=1.0),
)
ALL = np.ones(4, bool)


def test_what_has_no_effect_is_put_back():
    weights, none = put_back(PROBLEM, IDLE_START, FOUND, ALL)
    assert none.tolist() == [False, True, True, True]
    assert float(weights["gain"]) == pytest.approx(0.5)
    assert float(weights["late"]) == pytest.approx(2.0)
    np.testing.assert_allclose(weights["spare"], [5.0, 6.0])


def test_a_weight_that_acts_at_the_start_is_none():
    begun = {**IDLE_START, "late": jnp.asarray(4.5)}
    weights, none = put_back(PROBLEM, begun, FOUND, ALL)
    assert none.tolist() == [False, False, True, True]
    assert float(weights["late"]) == pytest.approx(3.0)


def test_nothing_is_looked_at_where_everything_has_a_slope():
    weights, none = put_back(PROBLEM, IDLE_START, FOUND, np.zeros(4, bool))
    assert weights is FOUND and not none.any()


def test_no_slope_of_errors_and_limits():
    errors, limits = np.zeros((1, 2, 3)), np.zeros((1, 3))
    errors[0, 1, 0], limits[0, 2] = 1e-30, -1.0
    assert exchange._flat(errors, limits).tolist() == [False, True, False]
    assert without_slope(None).size == 0
