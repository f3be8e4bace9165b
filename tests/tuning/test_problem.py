import jax.numpy as jnp
import numpy as np

from tuning.objectives import AtMost, Entry
from tuning.point import evaluate_point

START = {"x": jnp.asarray(0.5), "y": jnp.asarray(0.8)}
Z = np.log([0.5, 0.8])


def test_entries_of_limits(proportional_problem, loop_peaks):
    problem = proportional_problem(AtMost(peak_sensitivity=2.0), loops=loop_peaks)
    outcome = evaluate_point(problem, START, Z).outcome
    assert problem.limit_entries(outcome)[3] == Entry("peak_sensitivity", 1, 1)
    own = proportional_problem(lambda outcome: outcome.metrics.rms_control[0] - 1.0)
    assert own.limit_entries(outcome) == [Entry("limit", 0, 0), Entry("limit", 1, 0)]
