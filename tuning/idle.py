"""Weights without any effect, as a field of a controller that its step never reads.

A search may end anywhere along them: they are put back where they started.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from tuning.descents.descent import Descent
from tuning.parameters import Chart, Weights
from tuning.point import evaluate_point
from tuning.problem import Problem


def without_slope(descent: Descent | None) -> Bool[np.ndarray, " d"]:
    """Coordinates in which no error and no limit has a slope where a descent has come to.

    None of them where there is no descent.
    """
    if descent is None:
        return np.zeros(0, bool)
    model = descent.model
    return _flat(model.error_slopes, model.limit_slopes)


def put_back(
    problem: Problem, start: Weights, weights: Weights, flat: Bool[np.ndarray, " d"]
) -> tuple[Weights, Bool[np.ndarray, " d"]]:
    """Weights with those without any effect where they started, and which coordinates these are.

    They have no slope, neither at the start nor here, and putting them back changes no error and no
    limit.

    Args:
        problem: the tuning problem.
        start: where the search began.
        weights: that it found.
        flat: coordinates that may be without effect; the others are not looked at.
    """
    none = np.zeros(flat.shape, bool)
    if not flat.any():
        return weights, none
    first = np.asarray(Chart(problem.space, start).coordinates())
    z = np.asarray(Chart(problem.space, weights).coordinates())
    begun, here = (evaluate_point(problem, start, there) for there in (first, z))
    for point in (begun, here):
        if not point.diverged:  # or its slopes mean nothing
            flat = flat & _flat(point.slopes.errors, point.slopes.limits)
    back = np.where(flat, first, z)
    there = evaluate_point(problem, start, back)
    same = np.array_equal(there.errors, here.errors) and np.array_equal(there.limits, here.limits)
    if not (flat.any() and same):
        return weights, none
    return Chart(problem.space, start).weights(jnp.asarray(back)), flat


def _flat(*slopes: Float[Array | np.ndarray, "... d"]) -> Bool[np.ndarray, " d"]:
    """Coordinates in which every slope is zero, to the last bit."""
    return np.all([np.all(np.reshape(one, (-1, one.shape[-1])) == 0, axis=0) for one in slopes], 0)
