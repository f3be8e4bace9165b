"""A descent to a minimax under limits: a filter method with a trust region.

Every iteration linearises errors and limits, solves a quadratic program (`quadratic_step`) and
judges where its step leads:

    f   objective, mean over rows of the largest ln(error)
    h   largest violation of a limit

A point is accepted unless an earlier one has both smaller. So a step may leave a narrow curved
valley a little and come back, where a penalty would creep along its wall. A refused step is
corrected once for the curvature of errors and limits; then the trust region shrinks. The curvature
H of the Lagrangian comes from its gradients (BFGS, damped as Powell does).

The end of a descent is stationary when the model, with its curvature forgotten once, promises less
than the tolerance.

Source: R. Fletcher & S. Leyffer, Mathematical Programming 91 (2002); M. J. D. Powell, Lecture Notes
in Mathematics 630 (1978). Host side.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.qp.problem import Unsolved
from tuning.quadratic_step import Model, Step, quadratic_step

FIRST_MOVE, LARGEST_MOVE = 1.0, 5.0  # in z: a factor of 2.7, of 150, in a weight
SMALLEST_MOVE = 1e-8
COLLAPSED = 1e-3  # a trust region that is smaller tells nothing about what is around it
FLAT = 0.05  # curvature of a descent that knows none
# added where nothing but the limits is worth a step: the shortest one that meets them
STIFF = 1e3
CURVATURES = 1e-3, 1e3  # of a first guess
WITHIN = 1e-8  # a violation that counts as none
MARGIN = 1e-3  # of the filter
LEAST_GAIN = 1e-2  # part of the promised gain that a step must reach
LOST = 1.0  # rise of f beyond which a point tells nothing about the curvature
WASTED = 1e-3  # of its excess: a descent that cannot remove more is where its limits are nearest

Evaluate = Callable[[Float[np.ndarray, " d"]], Model | None]  # None for a point that diverges


class Descent(NamedTuple):
    """Complete state of a descent.

    Attributes:
        z: the point.
        model: errors, limits and slopes there.
        curvature: H.
        move: largest step in any coordinate.
        refused: (f, h) of points that no later one may be worse than in both.
        shares: of the errors, in the last quadratic program; so are the prices of the limits.
        prices: d f / d ln(bound) = -price.
        guessed: whether H is a guess still.
        confirming: whether H was forgotten since the last gain.
        steps: iterations made.
        done: whether it has ended.
        stationary: whether the model promises nothing at the point.
    """

    z: Float[np.ndarray, " d"]
    model: Model
    curvature: Float[np.ndarray, "d d"]
    move: float
    refused: Float[np.ndarray, "k 2"]
    shares: Float[np.ndarray, "g v"]
    prices: Float[np.ndarray, " c"]
    guessed: bool = True
    confirming: bool = False
    steps: int = 0
    done: bool = False
    stationary: bool = False


def begin(z: Float[np.ndarray, " d"], model: Model) -> Descent:
    """Descent at its first point."""
    return Descent(
        z=z,
        model=model,
        curvature=FLAT * np.eye(z.size),
        move=FIRST_MOVE,
        refused=np.zeros((0, 2)),
        shares=np.zeros_like(model.errors),
        prices=np.zeros_like(model.limits),
    )


def descend(
    descent: Descent,
    evaluate: Evaluate,
    box: tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]],
    tolerance: float,
) -> Descent:
    """One iteration: up to two evaluations.

    Args:
        descent: not done.
        evaluate: model of a point.
        box: smallest and largest z.
        tolerance: promised gain in f at which it ends.
    """
    descent = descent._replace(steps=descent.steps + 1)
    low = np.maximum(box[0] - descent.z, -descent.move)
    high = np.minimum(box[1] - descent.z, descent.move)

    here, curvature = descent.model, descent.curvature

    def solved(model: Model) -> Step:
        return quadratic_step(model, curvature, low, high)

    try:
        step = solved(here)
        descent = descent._replace(shares=step.shares, prices=step.prices)
        if step.gain + step.prices @ np.maximum(here.limits - WITHIN, 0.0) < tolerance:
            if _excess(here) == 0:
                return _forgetful(descent, stationary=True)
            curvature = curvature + STIFF * np.eye(descent.z.size)
            step = solved(here)
    except Unsolved:
        return _forgetful(descent)
    if _stranded(descent, step):
        return _wider(descent)
    there = first = evaluate(descent.z + step.d)
    reached = step.d
    if there is not None and not _accepted(descent, step, there):
        reached, there = _corrected(descent, step, there, evaluate, solved)
    if there is None or not _accepted(descent, step, there):
        shrunk = _shortening(descent, step, first) * np.max(np.abs(step.d))
        ended = shrunk < SMALLEST_MOVE
        return _curved(descent, step, first)._replace(move=shrunk, done=ended)
    corrected = there is not first
    return _moved(_curved(descent, step, first), step, reached, there, tolerance, corrected)


def _moved(
    descent: Descent, step: Step, d, there: Model, tolerance: float, corrected: bool
) -> Descent:
    here = descent.model
    gained = here.objective - there.objective
    restored = here.excess - there.excess
    towards = _of_objective(descent, step)
    ratio = gained / step.gain if towards else restored / max(here.excess - step.excess, 1e-300)
    still = descent.confirming and gained < tolerance and restored <= WASTED * here.excess
    size, move = np.max(np.abs(d)), descent.move
    if ratio > 0.75 and size > 0.9 * move:
        move = min((2.0 if corrected else 3.0) * move, LARGEST_MOVE)
    elif ratio < 0.1 and size > COLLAPSED:  # the shortest steps end in rounding
        move = 0.5 * size
    refused = descent.refused
    if not towards:
        refused = np.concatenate([refused, [[here.objective, _excess(here)]]])
    return descent._replace(
        z=descent.z + d,
        model=there,
        move=move,
        refused=refused,
        confirming=still,
        stationary=descent.stationary and still,
    )


def _shortening(descent: Descent, step: Step, there: Model | None) -> float:
    """Part of a refused step to try next: the lowest point of parabolas through every error."""
    if there is None:
        return 0.2
    here = descent.model
    line = here.moved(step.d)
    parts = np.array([0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5])

    def height(part: float) -> float:
        bent = here.moved(part * step.d)
        errors = bent.errors + part**2 * (there.errors - line.errors)
        return float(np.mean(np.max(errors, axis=1)))

    return float(parts[np.argmin([height(part) for part in parts])])


def _corrected(descent: Descent, step: Step, there: Model, evaluate: Evaluate, solved):
    """Second-order correction: the step again, with the errors of its own linear model removed."""
    here, line = descent.model, descent.model.moved(step.d)
    bent = here._replace(
        errors=here.errors + there.errors - line.errors,
        limits=here.limits + there.limits - line.limits,
    )
    try:
        d = solved(bent).d
    except Unsolved:
        return step.d, there
    apart = np.max(np.abs(d - step.d))
    if not 0 < apart < np.max(np.abs(step.d)):
        return step.d, there
    return d, evaluate(descent.z + d)


def _accepted(descent: Descent, step: Step, there: Model) -> bool:
    f, h = there.objective, _excess(there)
    here = descent.model.objective, _excess(descent.model)
    for earlier_f, earlier_h in [*descent.refused, here]:
        if h > (1 - MARGIN) * earlier_h and f > earlier_f - MARGIN * earlier_h:
            return False
    return here[0] - f >= LEAST_GAIN * step.gain if _of_objective(descent, step) else True


def _of_objective(descent: Descent, step: Step) -> bool:
    """Whether a step is for the objective's sake, and not for the limits'."""
    return step.gain > 1e-4 * _excess(descent.model)


def _excess(model: Model) -> float:
    return max(model.excess - WITHIN, 0.0)


def _stranded(descent: Descent, step: Step) -> bool:
    excess = descent.model.excess
    return excess > WITHIN and excess - step.excess < WASTED * excess


def _wider(descent: Descent) -> Descent:
    """A wider look once, and then the end: no step brings the limits nearer."""
    if descent.confirming or descent.move >= LARGEST_MOVE:
        return descent._replace(done=True)
    return descent._replace(move=LARGEST_MOVE, confirming=True)


def _forgetful(descent: Descent, stationary: bool = False) -> Descent:
    """The curvature forgotten; the end where it was forgotten before.

    A model that promises nothing says little where the trust region has collapsed.
    """
    stationary = descent.stationary or (stationary and descent.move >= COLLAPSED)
    if descent.confirming:
        return descent._replace(done=True, stationary=stationary)
    return descent._replace(
        curvature=FLAT * np.eye(descent.z.size),
        guessed=True,
        confirming=True,
        stationary=stationary,
        move=max(descent.move, 0.3 * FIRST_MOVE),
    )


def _curved(descent: Descent, step: Step, there: Model | None) -> Descent:
    """H with the curvature of the Lagrangian along a step.

    H + r r' / (d' r) - H d d' H / (d' H d), r = y mixed with H d so that d' r >= 0.2 d' H d
    """
    if there is None or there.objective > descent.model.objective + LOST:
        return descent
    if step.excess > WITHIN:  # the prices are those of limits out of reach
        return descent
    d, H = step.d, descent.curvature

    def slope(model: Model):
        objective = np.einsum("gv,gvd->d", step.shares, model.error_slopes)
        return objective + step.prices @ model.limit_slopes

    y = slope(there) - slope(descent.model)
    along = d @ y
    if descent.guessed and along > 0:
        H = float(np.clip(y @ y / along, *CURVATURES)) * np.eye(d.size)
    pulled = H @ d
    bend = d @ pulled
    if not bend > 0:
        return descent
    mix = 1.0 if along >= 0.2 * bend else 0.8 * bend / (bend - along)
    r = mix * y + (1 - mix) * pulled
    H = H - np.outer(pulled, pulled) / bend + np.outer(r, r) / (d @ r)
    return descent._replace(curvature=(H + H.T) / 2, guessed=descent.guessed and along <= 0)
