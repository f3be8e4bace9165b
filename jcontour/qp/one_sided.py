"""Limits of a `StagedQP` one by one, and Newton's equations of each, number by number.

For a limit g' v <= b with a slack s and a multiplier l, and t, g where it gives way at a price r,

    s + g' v - t = b,    l + g = r,    s l = c1,    t g = c2
a step along which g' v changes by d changes the multiplier by

    dl = W (d + pushed),    W = 1 / (s / l + t / g)
and the others so that each equation holds. All arguments are arrays of one shape.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jcontour.qp.staged import StagedQP, Trajectory

Numbers = Array  # of all limits


class Limits(NamedTuple):
    """Limits g' v <= b.

    Attributes:
        bound: b; zero where there is none.
        there: whether there is one.
        gives: whether it gives way.
        price: of a unit beyond it; 1 where it does not.
        width: half of what lies between two limits, or the size of a single one.
    """

    bound: Numbers
    there: Numbers
    gives: Numbers
    price: Numbers
    width: Numbers


class Point(NamedTuple):
    """A point of the path: the trajectory, and slacks s, t and multipliers l, g of the limits."""

    at: Any
    s: Numbers
    l: Numbers  # noqa: E741
    t: Numbers
    g: Numbers


class Changes(NamedTuple):
    """Changes of slacks and multipliers with a step."""

    s: Numbers
    l: Numbers  # noqa: E741
    t: Numbers
    g: Numbers


class Newton(NamedTuple):
    """Newton's equations of limits at a point."""

    missed: Numbers  # by how much s + g' v - t = b is
    price_missed: Numbers  # by how much l + g = r is
    weight: Numbers  # W
    # over_l, over_g: inverses of l and g; zero where there is no limit, and none that gives way
    over_l: Numbers
    over_g: Numbers


def sides(upper: Numbers, lower: Numbers, penalty: Numbers) -> tuple[Limits, Limits]:
    """Limits of rows from above and from below, the arrays all of one shape."""
    above, below = jnp.isfinite(upper), jnp.isfinite(lower)
    high, low = jnp.where(above, upper, 0.0), jnp.where(below, -lower, 0.0)
    largest = jnp.maximum(abs(high), abs(low))
    one = jnp.where(largest > 0, largest, 1.0)
    half = jnp.where(above & below, 0.5 * (high + low), one)
    width = jnp.where(half > 0, half, one)
    soft = jnp.isfinite(penalty)
    price = [jnp.where(there & soft, penalty, 1.0) for there in (above, below)]
    return (
        Limits(high, above, above & soft, price[0], width),
        Limits(low, below, below & soft, price[1], width),
    )


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


def first_point(at, slack: Numbers, mu: Numbers, limits: Limits, room: float) -> Point:
    """Slacks and multipliers to begin with: all products are mu.

    Args:
        at: the trajectory.
        slack: b - g' v of the limits there.
        mu: first value of the path's parameter.
        limits: the limits.
        room: of a limit's width that a slack begins with, at least.
    """
    s = jnp.where(limits.there, jnp.maximum(slack, room * limits.width), 1.0)
    l = jnp.where(limits.there, mu / s, 0.0)  # noqa: E741
    l = jnp.where(limits.gives, jnp.minimum(l, 0.5 * limits.price), l)  # noqa: E741
    g = jnp.where(limits.gives, limits.price - l, 1.0)
    return Point(at, s, l, jnp.where(limits.gives, mu / g, 0.0), g)


def newton(point: Point, limits: Limits, rows: Numbers) -> Newton:
    """Newton's equations of limits where g' v is `rows`."""
    _, s, l, t, g = point  # noqa: E741
    return Newton(
        missed_by(point, limits, rows),
        jnp.where(limits.gives, l + g - limits.price, 0.0),
        jnp.where(limits.there, l / softened_slack(point, limits), 0.0),
        jnp.where(limits.there, 1 / l, 0.0),
        jnp.where(limits.gives, 1 / g, 0.0),
    )


def missed_by(point: Point, limits: Limits, rows: Numbers) -> Numbers:
    """By how much s + g' v - t = b is missed."""
    return jnp.where(limits.there, point.s + rows - point.t - limits.bound, 0.0)


def softened_slack(point: Point, limits: Limits) -> Numbers:
    """Slack over multiplier, times the multiplier: s + l t / g."""
    way = jnp.where(limits.gives, point.t / point.g, 0.0)
    return point.s + way * point.l


def products(point: Point, limits: Limits) -> tuple[Numbers, Numbers]:
    """Products s l and t g: c1 and c2 of a predictor, whose aim is zero."""
    return point.s * point.l, point.t * jnp.where(limits.gives, point.g, 0.0)


def corrected(
    point: Point, limits: Limits, steps: Changes, share, target
) -> tuple[Numbers, Numbers]:
    """Products c1 and c2 of a corrector: with those of the predictor's steps, less the aim."""
    c1, c2 = products(point, limits)
    c1 = jnp.where(limits.there, c1 + share * steps.s * steps.l - target, 0.0)
    return c1, jnp.where(limits.gives, c2 + share * steps.t * steps.g - target, 0.0)


def pushes(here: Newton, point: Point, limits: Limits, c1: Numbers, c2: Numbers) -> Numbers:
    """Change of g' v that would change the multipliers as a step does where nothing moves."""
    way = (c2 - point.t * here.price_missed) * here.over_g
    return jnp.where(limits.there, here.missed - c1 * here.over_l + way, 0.0)


def changes(
    here: Newton, point: Point, limits: Limits, moved: Numbers, c1: Numbers, c2: Numbers
) -> Changes:
    """Changes with a step, `moved` is its change of g' v and what was pushed."""
    dl = here.weight * moved
    ds = -(c1 + point.s * dl) * here.over_l
    dg = jnp.where(limits.gives, -here.price_missed - dl, 0.0)
    return Changes(ds, dl, -(c2 + point.t * dg) * here.over_g, dg)


def possible(point: Point, steps: Changes, limits: Limits) -> Numbers:
    """Part of a step, at most all, after which each slack and multiplier is still positive."""
    longest: Any = 1.0
    for value, change, counts in (
        (point.s, steps.s, limits.there),
        (point.l, steps.l, limits.there),
        (point.t, steps.t, limits.gives),
        (point.g, steps.g, limits.gives),
    ):
        falls = counts & (change < 0)
        part = jnp.where(falls, -value / jnp.where(falls, change, 1.0), 1.0)
        longest = jnp.minimum(longest, part)
    return longest


def moved_on(point: Point, at, steps: Changes, far) -> Point:
    """Point after a part of a step; `at` is its trajectory."""
    s, l, t, g = (now + far * step for now, step in zip(point[1:], steps, strict=True))  # noqa: E741
    return Point(at, s, l, t, g)


def gap(point: Point) -> Numbers:
    """Products s l + t g, limit by limit; g is 1 where t is zero."""
    return point.s * point.l + point.t * point.g
