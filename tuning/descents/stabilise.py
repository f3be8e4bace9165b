"""The two ends of a descent: a stabilising start, and a landing inside the limits.

The start is a descent on one number that is below zero where a loop is sound. It is the logarithm
of the largest spectral radius of the frozen loops, without any run of the machine, or that of the
largest tracking error over the size of its contour. In its place the descent takes a smooth maximum
of all loops or runs a:

    s(z) = 1/p ln(mean over them of exp(p a / scale)),   p = SHARPNESS

The scale is how far the numbers lie from zero and from each other where the descent begins: loops
that hardly lose their stability, at radii of 1.0001 and 0.9997, are kept apart as well as those at
2 and 0.5. Steps go along L-BFGS directions from optax.

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

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Float

from jcontour.qp.problem import Unsolved
from tuning.descents.descent import FIRST_MOVE, MET, Descent, Evaluate, promises_nothing
from tuning.descents.quadratic_step import Model, least_excess_step
from tuning.objectives import LEAST
from tuning.parameters import Weights
from tuning.point import looked_at
from tuning.problem import Problem

SHARPNESS = 16.0
STEPS = 40  # a few lead out of any region that has a slope
TRIALS = 8  # shortenings of one step
LEAST_SCALE = 1e-6  # of the numbers: closer ones are the same
LARGEST_MOVE = 3.0  # in z: no weight changes by more than e^3 in one step
LEAST_FALL = 1e-4  # Armijo: part of the predicted fall that a step must reach
STILL = 1e-6  # fall of s below which nothing is left to gain


class Measured(NamedTuple):
    """The measure at a point."""

    numbers: Float[np.ndarray, " n"]  # a of all loops or runs, not finite where nothing can be said
    slopes: Float[np.ndarray, "n d"]  # of them
    sound: bool  # whether the search may end here

    @property
    def largest(self) -> float:
        """Of all loops or runs."""
        return float(np.max(self.numbers))

    def smooth(self, scale: float) -> "Smooth":
        """s at the point, and its slope; infinite where a number is not finite."""
        numbers, slopes = self.numbers / scale, self.slopes / scale
        if not np.isfinite(numbers).all():
            return Smooth(np.inf, np.full(slopes.shape[1], np.inf))
        powers = np.exp(SHARPNESS * (numbers - np.max(numbers)))
        value = np.max(numbers) + np.log(np.mean(powers)) / SHARPNESS
        return Smooth(float(value), powers @ slopes / np.sum(powers))


class Smooth(NamedTuple):
    """s at a point, and its slope."""

    value: float
    slope: Float[np.ndarray, " d"]

    @property
    def usable(self) -> bool:
        """Whether a step can start or end here."""
        return bool(np.isfinite(self.value) and np.isfinite(self.slope).all())


class Stabilised(NamedTuple):
    """End of a descent: the sound point, else that of the smallest measure."""

    z: Float[np.ndarray, " d"]
    largest: float
    sound: bool


def stabilised(
    z: Float[np.ndarray, " d"], measure: Callable[[Float[np.ndarray, " d"]], Measured]
) -> Stabilised:
    """Descent from z to the first sound point, or to where the measure falls no more.

    >>> def measure(z):  # |z| < 1 is sound
    ...     return Measured(np.array([z @ z - 1]), 2 * z[None], bool(z @ z < 1))
    >>> stabilised(np.array([3.0, 4.0]), measure).sound
    True
    """
    first = measure(z)
    best = Stabilised(z, first.largest, first.sound)
    scale = _scale(first.numbers)
    here = first.smooth(scale)
    if first.sound or not here.usable:
        return best
    memory = _fresh(z)
    for _ in range(STEPS):
        direction, memory = _direction(z, here.slope, memory)
        fall = float(direction @ here.slope)
        length = 1.0
        for _ in range(TRIALS):
            measured = measure(z + length * direction)
            there = measured.smooth(scale)
            if measured.largest < best.largest or measured.sound:
                best = Stabilised(z + length * direction, measured.largest, measured.sound)
            if measured.sound:
                return best
            if there.usable and there.value <= here.value + LEAST_FALL * fall * length:
                break
            length /= 4
        else:
            return best
        gained = here.value - there.value
        z, here = z + length * direction, there
        if gained < STILL:
            return best
    return best


def _scale(numbers: Float[np.ndarray, " n"]) -> float:
    """How far the numbers lie from zero and from each other; 1 at most."""
    if not np.isfinite(numbers).all():
        return 1.0
    apart = max(float(np.ptp(numbers)), abs(float(np.max(numbers))))
    return float(np.clip(apart, LEAST_SCALE, 1.0))


def loop_radii(
    problem: Problem, start: Weights, z: Float[np.ndarray, " d"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n d"]]:
    """Logarithms of the spectral radii of all loops at z, and their slopes.

    Raises:
        ValueError: the problem does not look at its loops.
    """
    looked, moved = looked_at(problem, start, z)
    peaks, slopes = looked.loops, moved.loops
    if peaks is None or slopes is None:
        raise ValueError("loops: this problem does not look at its frozen loops")
    radii = np.maximum(np.ravel(peaks.spectral_radius), LEAST)
    return np.log(radii), np.reshape(slopes.spectral_radius, (radii.size, -1)) / radii[:, None]


_lbfgs = optax.scale_by_lbfgs(memory_size=10)
_lbfgs_update = jax.jit(_lbfgs.update)


def _fresh(z: np.ndarray):
    return _lbfgs.init(jnp.asarray(z))


def _direction(z: np.ndarray, slope, memory) -> tuple[np.ndarray, Any]:
    with jax.numpy_dtype_promotion("standard"):  # optax adds counters of 32 and of 64 bits
        update, memory = _lbfgs_update(jnp.asarray(slope), memory, jnp.asarray(z))
    step = -np.asarray(update)
    if not step @ slope < 0:  # negative curvature spoilt the memory
        step, memory = -np.asarray(slope), _fresh(z)
    return step * min(1.0, LARGEST_MOVE / max(np.abs(step).max(), 1e-300)), memory


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
    """The descent, done, at a point within the limits; where it was if there is none.

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
