"""Norm-optimal iterative learning control on the contour error.

Amann, Owens & Rogers (1996), with the weight of contouring control. With the model G of how the
measured positions follow the correction, the next correction minimises

    sum_k e' W e + effort |c_{j+1} - c_j|^2 + size |c_{j+1}|^2,    e = e_j - G (c_{j+1} - c_j)
    W = alpha I + beta (I - t t')                                 t: unit tangent of the reference
    (G' W G + effort + size) d = G' W e_j - size c_j,             c_{j+1} = Q (c_j + d)
with the filter Q of `PType`. alpha + beta is one, so that the prices are relative. `effort` slows
learning, and averages noise. `size` forgets what costs more correction than it saves. Q forgets
what is too fast to be known: a machine that is later than its model needs it. G is a linearised
run, its transpose the derivative backwards. Of a short lap G is kept as a matrix, and the equation
is solved by Cholesky's factors; of a long one by conjugate gradients, without a matrix.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import is_concrete, whole_number
from jcontour.controller import checked_gain
from jcontour.controllers.learning.laps import LearningLaw, RunLap, smoothed
from jcontour.motion.references import Reference

TOLERANCE = 1e-9  # of the conjugate gradients, relative
ITERATIONS = 400  # at most; an effort of 0.01 needs some sixty
SHORT = 4000  # numbers in a correction up to which G is kept: 128 MB


class Matrix(eqx.Module):
    """Linear function of signals (T, m), as the matrix of their flattened samples."""

    values: Float[Array, "Tm Tm"]

    def __call__(self, signal: Float[Array, "T m"]) -> Float[Array, "T m"]:
        """The matrix times the signal."""
        return jnp.reshape(self.values @ jnp.ravel(signal), signal.shape)


class NormOptimal(LearningLaw):
    """Law that weighs the error across the path against the correction.

    Args:
        model: G, a linear function of a correction (T, m) that gives positions (T, m).
        tangent: t of the reference (T, m).
        contouring: beta, the part of the weight that is on the contour error alone; alpha is the
            rest.
        effort: price of a change of the correction.
        size: price of the correction.
        smoothing: n of Q; zero leaves it out.

    Raises:
        ValueError: a price is negative or not finite, the effort is zero, or the part is not
            between zero and one, or the smoothing is negative.
    """

    model: Callable[[Float[Array, "T m"]], Float[Array, "T m"]]
    tangent: Float[Array, "T m"]
    contouring: Float[Array, ""]
    effort: Float[Array, ""]
    size: Float[Array, ""]
    factor: Float[Array, "Tm Tm"] | None  # Cholesky's, where the model is a matrix
    smoothing: int = eqx.field(static=True)

    def __init__(
        self,
        model: Callable[[Any], Any],
        tangent,
        contouring: ArrayLike = 0.9,  # the lag along the path is a tenth as dear
        effort: ArrayLike = 0.03,  # a thirtieth of a slow contour error is left after a lap
        size: ArrayLike = 1e-4,  # a hundredth of a per cent of a slow error is left for good
        smoothing: int = 0,
    ):
        self.contouring = checked_gain("contouring", contouring)
        self.effort, self.size = checked_gain("effort", effort), checked_gain("size", size)
        if is_concrete(contouring) and not np.asarray(contouring) <= 1:
            raise ValueError(f"contouring: needs to be from zero to one, received {contouring}")
        if is_concrete(effort) and not np.asarray(effort) > 0:
            raise ValueError(f"effort: needs to be above zero, received {effort}")
        self.model, self.tangent = model, jnp.asarray(tangent)
        self.smoothing = whole_number("smoothing", smoothing)
        self.factor = self._factor(model.values) if isinstance(model, Matrix) else None

    def with_smoothing(self, smoothing: int) -> "NormOptimal":
        """The same law with another filter.

        Raises:
            ValueError: the smoothing is negative.
        """
        return NormOptimal(
            self.model, self.tangent, self.contouring, self.effort, self.size, smoothing
        )

    def update(
        self, correction: Float[Array, "T m"], error: Float[Array, "T m"]
    ) -> Float[Array, "T m"]:
        """Correction that the model takes for the best."""
        transposed = jax.linear_transpose(self.model, correction)
        (wanted,) = transposed(self._weighted(error))
        right = wanted - self.size * correction
        if self.factor is not None:
            flat = cho_solve((self.factor, True), jnp.ravel(right))
            change = jnp.reshape(flat, right.shape)
        else:

            def normal(change):
                (back,) = transposed(self._weighted(self.model(change)))
                return back + (self.effort + self.size) * change

            change, _ = cg(normal, right, tol=TOLERANCE, maxiter=ITERATIONS)
        return smoothed(correction + change, self.smoothing)

    def _factor(self, G: Array) -> Array:
        """Cholesky's lower factor of G' W G + prices."""
        columns = jnp.reshape(G, (*self.tangent.shape, -1))
        weighted = jax.vmap(self._weighted, in_axes=2, out_axes=2)(columns)
        normal = G.T @ jnp.reshape(weighted, G.shape)
        return jnp.linalg.cholesky(normal + (self.effort + self.size) * jnp.eye(len(G)))

    def _weighted(self, error: Float[Array, "T m"]) -> Float[Array, "T m"]:
        """W e, row by row: e - beta t (t . e)."""
        along = jnp.sum(self.tangent * error, axis=-1, keepdims=True)
        return error - self.contouring * along * self.tangent


def norm_optimal(run: RunLap, reference: Reference, **prices: Any) -> NormOptimal:
    """Law whose model is a run on a smooth machine, linearised at its first lap.

    Args:
        run: laps of the nominal machine without noise.
        reference: of one lap.
        prices: `contouring`, `effort`, `size` and `smoothing` of `NormOptimal`.
    """
    start = jnp.zeros_like(reference.position[: reference.steps])
    tangent = reference.tangent[: reference.steps]
    model = linearised(run, start)
    if start.size <= SHORT:  # its columns from all impulses at once
        impulses = jnp.reshape(jnp.eye(start.size, dtype=start.dtype), (-1, *start.shape))
        rows = jax.jit(jax.vmap(model))(impulses)
        model = Matrix(jnp.reshape(rows, (start.size, -1)).T)
    return NormOptimal(model, tangent, **prices)


def linearised(run: RunLap, start: Float[Array, "T m"]) -> Callable[[Any], Any]:
    """Change of the measured positions with the correction: minus that of the error."""
    _, slope = jax.linearize(lambda correction: -run(correction, jnp.zeros((), int)).error, start)
    return eqx.filter_closure_convert(slope, start)
