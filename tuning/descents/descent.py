"""A descent to a minimax under limits: an exact penalty with a trust region.

Every iteration linearises errors and limits, solves a quadratic program (`quadratic_step`) and
judges where its step leads by the merit

    f + penalty h     f   objective, mean over rows of the largest ln(error)
                      h   largest violation of a limit

A step that gains less than promised is corrected once for the curvature of errors and limits, so
that the descent follows a narrow curved valley; then the trust region shrinks. The penalty is
raised by the quadratic program, and falls where the limits hold and their prices are small. The
curvature H of the Lagrangian comes from its gradients (BFGS, damped as Powell does).

Where no step inside the trust region removes most of h, the largest limit alone is made small, as a
minimax with a curvature of its own. A penalty that outweighs f there would outweigh H, too, and the
descent would zigzag.

The end of a descent is stationary when the model, with its curvature forgotten once, promises less
than the tolerance.

Source: R. Fletcher, Practical Methods of Optimization (1987), ch. 14.4 (S l1 QP); M. J. D. Powell,
Lecture Notes in Mathematics 630 (1978). Host side.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.qp.problem import Unsolved
from tuning.descents.quadratic_step import LEFT, Model, Step, least_excess, quadratic_step

FIRST_MOVE, LARGEST_MOVE = 1.0, 5.0  # in z: a factor of 2.7, of 150, in a weight
SMALLEST_MOVE = 1e-7
COLLAPSED = 1e-3  # a trust region that is smaller tells nothing about what is around it
FLAT = 0.05  # curvature of a descent that knows none
CURVATURES = 1e-3, 1e3  # of a first guess
LEAST_PENALTY = 1e-2  # the quadratic program raises it where it is too small
DEAR = 10.0  # penalty over the prices at which it falls
MET = 5e-7  # a violation that counts as none
LEAST_GAIN = 1e-2  # part of the promised gain that a step must reach
POOR, GOOD = 0.25, 0.75  # parts of it that shrink and widen the trust region
LOST = 1.0  # rise of f beyond which a point tells nothing about the curvature
WASTED = 1e-3  # of its excess: a descent that cannot remove more is where its limits are nearest
NEAREST = 1e-4  # likewise where the limits alone are made small, along a valley perhaps

Evaluate = Callable[[Float[np.ndarray, " d"]], Model | None]  # None for a point that diverges


class Descent(NamedTuple):
    """Complete state of a descent."""

    z: Float[np.ndarray, " d"]  # the point
    model: Model  # errors, limits and slopes there
    curvature: Float[np.ndarray, "d d"]  # H
    move: float  # largest step in any coordinate
    penalty: float  # of an excess
    # of the errors, in the last quadratic program; so are the prices of the limits
    shares: Float[np.ndarray, "g v"]
    prices: Float[np.ndarray, " c"]  # d f / d ln(bound) = -price
    # curvature of the limits alone, while they are what is made small
    spare: Float[np.ndarray, "d d"]
    guessed: bool = True  # whether H is a guess still
    spare_guessed: bool = True  # whether the other one is
    restoring: bool = False  # whether the limits alone were made small in the last iteration
    confirming: bool = False  # whether H was forgotten since the last gain
    steps: int = 0  # iterations made
    done: bool = False  # whether it has ended
    stationary: bool = False  # whether the model promises nothing at the point
    # whether its end was brought inside the limits, or could not be (`landing`)
    landed: bool = False


def begin(z: Float[np.ndarray, " d"], model: Model) -> Descent:
    """Descent at its first point."""
    return Descent(
        z=z,
        model=model,
        curvature=FLAT * np.eye(z.size),
        move=FIRST_MOVE,
        penalty=LEAST_PENALTY,
        shares=np.zeros_like(model.errors),
        prices=np.zeros_like(model.limits),
        spare=FLAT * np.eye(z.size),
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
    low = np.maximum(box[0] - descent.z, -descent.move)
    high = np.minimum(box[1] - descent.z, descent.move)
    if _within_reach(descent.model, low, high):
        return _iterated(descent._replace(restoring=False), evaluate, (low, high), tolerance)
    return _restored(descent, evaluate, (low, high))


def promises_nothing(descent: Descent, box, tolerance: float) -> bool:
    """Whether the model at a point within its limits promises less than the tolerance.

    The curvature is that of the descent, and flat: what either of them promises counts.
    """
    low = np.maximum(box[0] - descent.z, -FIRST_MOVE)
    high = np.minimum(box[1] - descent.z, FIRST_MOVE)
    flat = FLAT * np.eye(descent.z.size)
    try:
        steps = [
            quadratic_step(descent.model, curvature, low, high, descent.penalty)
            for curvature in (descent.curvature, flat)
        ]
    except Unsolved:
        return False
    return all(step.gain < tolerance for step in steps)


def _within_reach(here: Model, low, high) -> bool:
    """Whether some step removes most of the excess."""
    try:
        return least_excess(here, low, high) <= LEFT * here.excess
    except Unsolved:  # nothing is known: the steps below say so once more
        return True


def _restored(descent: Descent, evaluate: Evaluate, box) -> Descent:
    """One iteration that makes the largest limit small, whatever becomes of the objective.

    A penalty would have to be so large that the curvature of the limits is lost beside it.
    """
    models = {descent.z.tobytes(): descent.model}
    slopes = descent.model.limit_slopes[np.argmax(descent.model.limits)]
    size = float(np.max(np.abs(slopes), initial=1e-9))  # one that holds may be far steeper

    def limits_alone(z) -> Model | None:
        model = evaluate(z)
        if model is None:
            return None
        models[z.tobytes()] = model
        return _limits_alone(model, size)

    inner = descent._replace(
        model=_limits_alone(descent.model, size),
        curvature=descent.spare if descent.spare_guessed else descent.spare / size,
        guessed=descent.spare_guessed,
        restoring=True,
    )
    after = _iterated(inner, limits_alone, box, NEAREST * descent.model.excess / size)
    return after._replace(
        model=models[after.z.tobytes()],
        curvature=descent.curvature,
        guessed=descent.guessed,
        spare=after.curvature if after.guessed else after.curvature * size,
        spare_guessed=after.guessed,
        shares=descent.shares,
        prices=descent.prices,
        penalty=descent.penalty,
        stationary=False,
    )


def _limits_alone(model: Model, size: float) -> Model:
    """The limits over a size in the place of the errors."""
    limits, slopes = model.limits / size, model.limit_slopes / size
    return Model(limits[None], limits[:0], slopes[None], slopes[:0])


def _iterated(descent: Descent, evaluate: Evaluate, box, tolerance: float) -> Descent:
    """One iteration with an exact penalty on what the model has of limits."""
    descent = descent._replace(steps=descent.steps + 1)
    here, curvature = descent.model, descent.curvature
    low, high = box
    try:
        step = quadratic_step(here, curvature, low, high, descent.penalty)
    except Unsolved:
        return _forgetful(descent)
    descent = descent._replace(shares=step.shares, prices=step.prices, penalty=step.penalty)
    if not _counts(here, step.gain, step.excess, tolerance):
        return _forgetful(descent, stationary=here.excess <= MET)
    d, there = step.d, evaluate(descent.z + step.d)
    bent = _curved(descent, step, there)
    shortened = _shortening(descent, step, there) * float(np.max(np.abs(step.d)))
    corrected = False
    if there is not None and _gained(descent, there) < POOR * step.gain:
        other = _correction(descent, step, there, low, high)
        again = None if other is None else evaluate(descent.z + other)
        if other is not None and _gained(descent, again) > _gained(descent, there):
            d, there, corrected = other, again, True
    if there is None or _gained(descent, there) < LEAST_GAIN * step.gain:
        return bent._replace(move=shortened, done=shortened < SMALLEST_MOVE)
    return _moved(bent, step, d, there, tolerance, corrected)


def _moved(
    descent: Descent, step: Step, d, there: Model, tolerance: float, corrected: bool
) -> Descent:
    here, penalty = descent.model, descent.penalty
    gained = _gained(descent, there)
    size, move = float(np.max(np.abs(d))), descent.move
    if gained > GOOD * step.gain and size > 0.9 * move:
        move = min((2.0 if corrected else 3.0) * move, LARGEST_MOVE)
    elif gained < POOR * step.gain and size > COLLAPSED:  # the shortest steps end in rounding
        move = 0.5 * size
    if there.excess <= MET:
        penalty = min(penalty, max(LEAST_PENALTY, DEAR * float(np.sum(step.prices))))
    still = descent.confirming and not _counts(here, gained, there.excess, tolerance)
    return descent._replace(
        z=descent.z + d,
        model=there,
        move=move,
        penalty=penalty,
        confirming=still,
        stationary=descent.stationary and still,
    )


def _gained(descent: Descent, there: Model | None) -> float:
    """Decrease of the merit."""
    if there is None:
        return -np.inf
    return descent.model.merit(descent.penalty) - there.merit(descent.penalty)


def _counts(here: Model, gain: float, excess: float, tolerance: float) -> bool:
    """Whether a gain is worth a step; beyond the limits, whether what it removes of the excess is.

    A sum of the two would not do: beyond the limits the penalty may be of any size.
    """
    return gain >= tolerance if here.excess <= MET else excess <= (1 - WASTED) * here.excess


def _shortening(descent: Descent, step: Step, there: Model | None) -> float:
    """Part of a refused step to try next: the lowest point of parabolas through every number."""
    if there is None:
        return 0.2
    here, line = descent.model, descent.model.moved(step.d)
    parts = np.array([0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5])

    def height(part: float) -> float:
        straight = here.moved(part * step.d)
        bent = straight._replace(
            errors=straight.errors + part**2 * (there.errors - line.errors),
            limits=straight.limits + part**2 * (there.limits - line.limits),
        )
        return bent.merit(descent.penalty)

    return float(parts[np.argmin([height(part) for part in parts])])


def _correction(descent: Descent, step: Step, there: Model, low, high) -> np.ndarray | None:
    """Second-order correction: the step again, with the errors of its own linear model removed.

    None where there is no other step near it.
    """
    here, line = descent.model, descent.model.moved(step.d)
    bent = here._replace(
        errors=here.errors + there.errors - line.errors,
        limits=here.limits + there.limits - line.limits,
    )
    try:
        d = quadratic_step(bent, descent.curvature, low, high, descent.penalty).d
    except Unsolved:
        return None
    apart = np.max(np.abs(d - step.d))
    return d if 0 < apart < np.max(np.abs(step.d)) else None


def _forgetful(descent: Descent, stationary: bool = False) -> Descent:
    """The curvature forgotten; the end where it was forgotten before.

    A model that promises nothing says little where the trust region has collapsed. Beyond the
    limits the next look is the widest.
    """
    stationary = descent.stationary or (stationary and descent.move >= COLLAPSED)
    if descent.confirming:
        return descent._replace(done=True, stationary=stationary)
    within = descent.model.excess <= MET and not descent.restoring
    return descent._replace(
        curvature=FLAT * np.eye(descent.z.size),
        guessed=True,
        confirming=True,
        stationary=stationary,
        move=max(descent.move, 0.3 * FIRST_MOVE) if within else LARGEST_MOVE,
    )


def _curved(descent: Descent, step: Step, there: Model | None) -> Descent:
    """H with the curvature of the Lagrangian along a step.

    H + r r' / (d' r) - H d d' H / (d' H d), r = y mixed with H d so that d' r >= 0.2 d' H d
    """
    if there is None or there.objective > descent.model.objective + LOST:
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
