"""Norm-optimal iterative learning control on the contour error.

Amann, Owens & Rogers (1996), with the weight of contouring control. With the model G of how the
measured positions follow the correction, the next correction minimises

    sum_k e' W e + effort |c_{j+1} - c_j|^2 + size |c_{j+1}|^2,    e = e_j - G (c_{j+1} - c_j)
    W = alpha I + beta (I - t t')                                 t: unit tangent of the reference
    (G' W G + effort + size) d = G' W e_j - size c_j,             c_{j+1} = c_j + d
alpha + beta is one, so that the prices are relative. `effort` slows learning and keeps it safe
under model errors; `size` forgets: it leaves what costs more correction than it saves, noise above
all. G is never formed: it is a linearised run, its transpose the derivative backwards, and the
equation is solved by conjugate gradients.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import checked_gain
from jcontour.controllers.learning.convergence import frequency_response
from jcontour.controllers.learning.laps import LearningLaw, RunLap
from jcontour.motion.references import Reference
from jcontour.tracing import is_concrete

TOLERANCE = 1e-9  # of the conjugate gradients, relative
ITERATIONS = 400  # at most; an effort of 0.01 needs some sixty


class NormOptimal(LearningLaw):
    """Law that weighs the error across the path against the correction.

    Args:
        model: G, a linear function of a correction (T, m) that gives positions (T, m).
        tangent: t of the reference (T, m).
        contouring: beta, the part of the weight that is on the contour error alone; alpha is the
            rest.
        effort: price of a change of the correction.
        size: price of the correction.

    Raises:
        ValueError: a price is negative or not finite, the effort is zero, or the part is not
            between zero and one.
    """

    model: Callable[[Float[Array, "T m"]], Float[Array, "T m"]]
    tangent: Float[Array, "T m"]
    contouring: Float[Array, ""]
    effort: Float[Array, ""]
    size: Float[Array, ""]

    def __init__(
        self,
        model: Callable[[Any], Any],
        tangent,
        contouring: ArrayLike = 0.9,  # the lag along the path is a tenth as dear
        effort: ArrayLike = 0.03,  # a thirtieth of a slow contour error is left after a lap
        size: ArrayLike = 1e-4,  # a hundredth of a per cent of a slow error is left for good
    ):
        self.contouring = checked_gain("contouring", contouring)
        self.effort, self.size = checked_gain("effort", effort), checked_gain("size", size)
        if is_concrete(contouring) and not np.asarray(contouring) <= 1:
            raise ValueError(f"contouring: needs to be from zero to one, received {contouring}")
        if is_concrete(effort) and not np.asarray(effort) > 0:
            raise ValueError(f"effort: needs to be above zero, received {effort}")
        self.model, self.tangent = model, jnp.asarray(tangent)

    def update(
        self, correction: Float[Array, "T m"], error: Float[Array, "T m"]
    ) -> Float[Array, "T m"]:
        """Correction that the model takes for the best."""
        transposed = jax.linear_transpose(self.model, correction)
        prices = self.effort + self.size

        def normal(change):
            (back,) = transposed(self._weighted(self.model(change)))
            return back + prices * change

        (wanted,) = transposed(self._weighted(error))
        right = wanted - self.size * correction
        change, _ = cg(normal, right, tol=TOLERANCE, maxiter=ITERATIONS)
        return correction + change

    def iteration(self, frequency, response, place: int):
        """(H + prices)^-1 (effort + G' W (G - T)), H = G' W G, with W and G around the place."""
        G = frequency_response(self.model, self.tangent.shape, place, len(frequency))
        t = np.asarray(self.tangent)[place]
        eye = np.eye(len(t))
        W = eye - float(self.contouring) * np.outer(t, t)
        back = np.conj(np.swapaxes(G, 1, 2)) @ W
        prices = float(self.effort + self.size)
        step = float(self.effort) * eye + back @ (G - np.asarray(response))
        return np.linalg.solve(back @ G + prices * eye, step)

    def _weighted(self, error: Float[Array, "T m"]) -> Float[Array, "T m"]:
        """W e, row by row: e - beta t (t . e)."""
        along = jnp.sum(self.tangent * error, axis=-1, keepdims=True)
        return error - self.contouring * along * self.tangent


def norm_optimal(run: RunLap, reference: Reference, **prices: ArrayLike) -> NormOptimal:
    """Law whose model is a run on a smooth machine, linearised at its first lap.

    Args:
        run: laps of the nominal machine without noise.
        reference: of one lap.
        prices: `contouring`, `effort` and `size` of `NormOptimal`.
    """
    start = jnp.zeros_like(reference.position[: reference.steps])
    tangent = reference.tangent[: reference.steps]
    return NormOptimal(linearised(run, start), tangent, **prices)


def linearised(run: RunLap, start: Float[Array, "T m"]) -> Callable[[Any], Any]:
    """Change of the measured positions with the correction: minus that of the error."""
    _, slope = jax.linearize(lambda correction: -run(correction, jnp.zeros((), int)).error, start)
    return eqx.filter_closure_convert(slope, start)
