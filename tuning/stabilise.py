"""A stabilising start: weights whose frozen loops are all stable.

The largest spectral radius of the frozen loops is made small, without any run of the machine:

    r(z) = (mean over probes and plants of radius^p)^(1/p),   p = SHARPNESS
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from tuning.parameters import Chart, Weights
from tuning.problem import Problem, smooth_maximum

STEPS = 60  # of the descent; stable weights are usually found within ten
LARGEST = 1e6  # stands for a radius that is not finite


class Stabilised(NamedTuple):
    """End of a descent on the spectral radius.

    Attributes:
        z: coordinates of the smallest radius found.
        radius: largest spectral radius there.
        accepted: whether the descent ended at a point that was accepted.
    """

    z: Float[np.ndarray, " d"]
    radius: float
    accepted: bool


def stabilised(
    problem: Problem,
    start: Weights,
    z: Float[np.ndarray, " d"],
    accept: Callable[[Float[np.ndarray, " d"]], bool],
) -> Stabilised:
    """Descent on the largest spectral radius, from z to the first accepted point.

    Args:
        problem: one that looks at its loops.
        start: weights that the coordinates belong to.
        z: first coordinates.
        accept: asked where all loops are stable; False goes on to a smaller radius.

    Raises:
        ValueError: the problem does not look at its loops.
    """
    best = Stabilised(z, np.inf, False)

    def radius(z):
        nonlocal best
        value, largest, slope = jax.device_get(_radius(problem, start, jnp.asarray(z)))
        if not (np.isfinite(value) and np.isfinite(slope).all()):
            return np.log(LARGEST), np.zeros_like(z)
        if largest < best.radius:
            best = Stabilised(np.array(z), float(largest), False)
        return float(value), np.asarray(slope)

    def look(intermediate_result):
        nonlocal best
        if best.radius < 1 and accept(best.z):
            best = best._replace(accepted=True)
            raise StopIteration

    minimize(radius, z, jac=True, method="BFGS", callback=look, options={"maxiter": STEPS})
    return best


@eqx.filter_jit
def _radius(
    problem: Problem, start: Weights, z: Float[Array, " d"]
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, " d"]]:
    """Logarithm of r, the largest radius, and the slope of the first."""

    def smooth(z):
        radii = jnp.ravel(
            problem.loop_peaks(Chart(problem.space, start).weights(z)).spectral_radius
        )
        even = jnp.full(radii.size, 1 / radii.size)
        return jnp.log(smooth_maximum(radii, even)), jnp.max(radii)

    (value, largest), slope = jax.value_and_grad(smooth, has_aux=True)(z)
    return value, largest, slope
