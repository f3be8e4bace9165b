"""The limits of a `StagedQP` as one-sided ones: values, pull, and what they add to H."""

import jax
import jax.numpy as jnp

from jcontour.qp.one_sided import Limits, sides
from jcontour.qp.staged import StagedQP, Trajectory


def one_sided_limits(qp: StagedQP) -> Limits:
    """Limits as one-sided ones, upper before lower (2, N, r)."""
    pair = sides(qp.upper, qp.lower, jnp.broadcast_to(qp.penalty, qp.upper.shape))
    return jax.tree.map(lambda *both: jnp.stack(both), *pair)


def rows(qp: StagedQP, at: Trajectory):
    """Values g' v of the one-sided limits."""
    value = at.stages @ qp.D.T
    return jnp.stack([value, -value])


def pulled(qp: StagedQP, multipliers) -> Trajectory:
    """Slope G' l of the limits; none reaches the last state."""
    stages = (multipliers[0] - multipliers[1]) @ qp.D
    return Trajectory(stages, jnp.zeros_like(qp.x0))


def gram(qp: StagedQP, weight):
    """Sum of W d d' over the rows d of every stage."""
    v = qp.D.shape[1]
    squares = (qp.D[:, :, None] * qp.D[:, None, :]).reshape(-1, v * v)
    return (jnp.sum(weight, axis=0) @ squares).reshape(-1, v, v)
