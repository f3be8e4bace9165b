"""How much may be tried."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from tuning.objectives import AtMost, Entry
from tuning.point import evaluate_point
from tuning.problem import QUICK, THOROUGH

START = {"x": jnp.asarray(0.5), "y": jnp.asarray(0.8)}
Z = np.log([0.5, 0.8])


def test_entries_of_limits(proportional_problem, loop_peaks):
    problem = proportional_problem(AtMost(peak_sensitivity=2.0), loops=loop_peaks)
    outcome = evaluate_point(problem, START, Z).outcome
    assert problem.limit_entries(outcome)[3] == Entry("peak_sensitivity", 1, 1)
    own = proportional_problem(lambda outcome: outcome.metrics.rms_control[0] - 1.0)
    assert own.limit_entries(outcome) == [Entry("limit", 0, 0), Entry("limit", 1, 0)]


@pytest.mark.parametrize(
    "bad",
    [
        {"starts": 0},
        {"scatter": -1},
        {"steps": 0},
        {"seed": -1},
        {"tolerance": 0.0},
        {"evaluations": 0},
    ],
)
def test_bad_settings_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        replace(THOROUGH, **bad)


def test_many_scattered_points_are_worth_a_program_of_their_own():
    assert THOROUGH.values_alone and not QUICK.values_alone
