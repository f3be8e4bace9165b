"""A stabilising start: a descent on one number that is below zero where a loop is sound.

The number is the logarithm of the largest spectral radius of the frozen loops, without any run of
the machine, or that of the largest tracking error over the size of its contour. In its place the
descent takes a smooth maximum:

    s(z) = 1/p ln(mean over loops or runs of exp(p a)),   p = SHARPNESS

along L-BFGS directions from optax.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Float

from tuning.objectives import LEAST
from tuning.parameters import Weights
from tuning.point import looked_at
from tuning.problem import Problem

SHARPNESS = 16.0
STEPS = 40  # a few lead out of any region that has a slope
TRIALS = 8  # shortenings of one step
LARGEST_MOVE = 3.0  # in z: no weight changes by more than e^3 in one step
LEAST_FALL = 1e-4  # Armijo: part of the predicted fall that a step must reach
STILL = 1e-6  # fall of s below which nothing is left to gain


class Measured(NamedTuple):
    """The measure at a point.

    Attributes:
        largest: of all loops or runs, not finite where nothing can be said.
        smooth: s.
        slope: of s.
        sound: whether the search may end here.
    """

    largest: float
    smooth: float
    slope: Float[np.ndarray, " d"]
    sound: bool


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
    ...     return Measured(z @ z - 1, z @ z, 2 * z, bool(z @ z < 1))
    >>> stabilised(np.array([3.0, 4.0]), measure).sound
    True
    """
    here = measure(z)
    best = Stabilised(z, here.largest, here.sound)
    if here.sound or not _usable(here):
        return best
    memory = _fresh(z)
    for _ in range(STEPS):
        direction, memory = _direction(z, here.slope, memory)
        fall = float(direction @ here.slope)
        length = 1.0
        for _ in range(TRIALS):
            there = measure(z + length * direction)
            if there.largest < best.largest or there.sound:
                best = Stabilised(z + length * direction, there.largest, there.sound)
            if there.sound:
                return best
            if _usable(there) and there.smooth <= here.smooth + LEAST_FALL * fall * length:
                break
            length /= 4
        else:
            return best
        gained = here.smooth - there.smooth
        z, here = z + length * direction, there
        if gained < STILL:
            return best
    return best


def loop_radius(
    problem: Problem, start: Weights, z: Float[np.ndarray, " d"]
) -> tuple[float, float, Float[np.ndarray, " d"]]:
    """Logarithm of the largest spectral radius at z, s, and the slope of s.

    Raises:
        ValueError: the problem does not look at its loops.
    """
    (peaks, _), (slopes, _) = looked_at(problem, start, z)
    if peaks is None or slopes is None:
        raise ValueError("loops: this problem does not look at its frozen loops")
    radii = np.maximum(np.ravel(peaks.spectral_radius), LEAST)
    relative = np.reshape(slopes.spectral_radius, (radii.size, -1)) / radii[:, None]
    return float(np.log(radii.max())), *smooth_maximum(np.log(radii), relative)


def smooth_maximum(
    numbers: Float[np.ndarray, " n"], slopes: Float[np.ndarray, "n d"]
) -> tuple[float, Float[np.ndarray, " d"]]:
    """s, and its slope; infinite where a number is not finite."""
    if not np.isfinite(numbers).all():
        return np.inf, np.full(slopes.shape[1], np.inf)
    powers = np.exp(SHARPNESS * (numbers - np.max(numbers)))
    value = np.max(numbers) + np.log(np.mean(powers)) / SHARPNESS
    return float(value), powers @ slopes / np.sum(powers)


def _usable(point: Measured) -> bool:
    return bool(np.isfinite(point.smooth) and np.isfinite(point.slope).all())


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
