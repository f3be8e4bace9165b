"""The end of a descent brought inside its limits.

A descent follows curved limits from outside: it may end a hair beyond them, at a point that nothing
but this hair makes worthless. The nearest point is looked for at which every limit holds with some
margin r,

    least |d|  subject to  c + C d <= -r,  low <= d <= high

with the lines of all points that were tried on the way: a limit that is the largest of many numbers
has more than one slope there. While its answer lies outside the margin is doubled. A last point, on
the way back, gives up the margin that was not needed.

Source: the restoration step of J. Nocedal & S. Wright, Numerical Optimization (2006), ch. 18.
Host side.
"""

import numpy as np
from jaxtyping import Float

from jcontour.qp.problem import Unsolved
from tuning.descents.descent import FIRST_MOVE, MET, Descent, Evaluate, promises_nothing
from tuning.descents.quadratic_step import Model, least_excess_step

TRIES = 4  # evaluations: two do for a smooth limit
MARGIN = 0.5  # over the excess, at first
KEPT = 0.1  # part of the margin that the way back leaves


def outside(descent: Descent) -> bool:
    """Whether a descent stands beyond a limit."""
    return descent.model.excess > MET


def landed(
    descent: Descent,
    evaluate: Evaluate,
    box: tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]],
    tolerance: float,
    tries: int = TRIES,
) -> Descent:
    """The descent, done, at a point within the limits; where it was if none is found.

    Args:
        descent: that stands outside.
        evaluate: model of a point.
        box: smallest and largest z.
        tolerance: promised gain in f below which the point is stationary.
        tries: evaluations at most.
    """
    known = [(descent.z, descent.model)]
    margin = MARGIN
    for left in range(tries - 1, -1, -1):
        z, here = min(known, key=lambda one: one[1].excess)
        step = _nearest(known, z, margin * here.excess, box)
        model = None if step is None else evaluate(z + step)
        if step is None or model is None:
            break
        if model.excess <= MET:
            inside = _way_back(descent, (z + step, model), evaluate, tolerance if left else np.inf)
            return _ended(descent, *inside, box, tolerance)
        known.append((z + step, model))
        margin *= 2
    return descent._replace(done=True, landed=True)


def _nearest(known, z, margin: float, box) -> np.ndarray | None:
    """The shortest step to where every line of the limits holds with some margin; None for none."""
    here = known[0][1]
    lines = [model.limits + model.limit_slopes @ (z - there) for there, model in known]
    model = here._replace(
        limits=np.concatenate(lines) + margin,
        limit_slopes=np.concatenate([model.limit_slopes for _, model in known]),
    )
    low = np.maximum(box[0] - z, -FIRST_MOVE)
    high = np.minimum(box[1] - z, FIRST_MOVE)
    try:
        step = least_excess_step(model, low, high)
    except Unsolved:
        return None
    return step if model.moved(step).excess < margin else None


def _way_back(descent: Descent, inside: tuple, evaluate: Evaluate, tolerance: float) -> tuple:
    """The point inside, or one between it and the end of the descent that gives up its margin."""
    z, model = inside
    spare = -float(np.max(model.limits))
    if model.objective - descent.model.objective <= tolerance or spare <= 0:
        return inside
    part = (1 - KEPT) * spare / (spare + descent.model.excess)
    between = z + part * (descent.z - z)
    there = evaluate(between)
    if there is None or there.excess > MET or there.objective >= model.objective:
        return inside
    return between, there


def _ended(descent: Descent, z, model: Model, box, tolerance: float) -> Descent:
    there = descent._replace(z=z, model=model, done=True, landed=True)
    return there._replace(stationary=promises_nothing(there, box, tolerance))
