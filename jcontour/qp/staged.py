"""A quadratic program over the stages of a horizon, in JAX: the form of optimal control problems.

    minimise    sum_j 1/2 v_j' H_j v_j + h_j' v_j  +  1/2 x_N' H_N x_N + h_N' x_N
    subject to  x_{j+1} = A x_j + B u_j + c_j,    x_0 given,    lower_j <= D v_j <= upper_j

v_j = (x_j, u_j), j = 0..N-1. `QP` of `problem` is the same with the states eliminated, for solvers
on the host; here they stay, and the work of a Newton step grows with N instead of N^3.

Its limits one by one, and Newton's equations of each, number by number: for a limit g' v <= b with
a slack s and a multiplier l, and t, g where it gives way at a price r,

    s + g' v - t = b,    l + g = r,    s l = c1,    t g = c2
a step along which g' v changes by d changes the multiplier by

    dl = W (d + constant),    W = 1 / (s / l + t / g)
and the others so that each equation holds. All these are arrays of one shape.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float


class StagedQP(NamedTuple):
    """The numbers of one problem; limits may be infinite, and differ from stage to stage."""

    # A, B, c: model of a stage, and what is added to its next state
    A: Float[Array, "n n"]
    B: Float[Array, "n p"]
    c: Float[Array, "N n"]
    x0: Float[Array, " n"]  # first state
    # H, h: cost of the stages; of H its symmetric part counts, whose part of the controls is
    # positive definite where nothing behind makes it so
    H: Float[Array, "N v v"]
    h: Float[Array, "N v"]
    # H_end, h_end: cost of the last state
    H_end: Float[Array, "n n"]
    h_end: Float[Array, " n"]
    D: Float[Array, "r v"]  # rows that are limited
    # lower, upper: their limits
    lower: Float[Array, "N r"]
    upper: Float[Array, "N r"]
    # cost of a unit beyond a limit, by row; infinite where the limit is hard
    penalty: Float[Array, " r"]


class Trajectory(NamedTuple):
    """States and controls of a horizon, and its last state."""

    stages: Float[Array, "N v"]
    end: Float[Array, " n"]


class Factors(NamedTuple):
    """Feedback law of a backward sweep: u_j = -R^-1 (Y x_j + y) with R'R = H_uu + B' P B."""

    Y: Float[Array, "N p n"]  # R'^-1 (H_ux + B' P A)
    y: Float[Array, "N p"]  # R'^-1 (h_u + B' q)
    R: Float[Array, "N p p"]  # by its rows, with the inverse of the diagonal in its place


def rollout(qp: StagedQP, controls: Float[Array, "N p"]) -> Trajectory:
    """States that the controls lead to."""
    x, end = _simulated(qp, qp.x0, controls, qp.c)
    return Trajectory(jnp.concatenate([x, controls], axis=1), end)


def backward_sweep(
    qp: StagedQP, H: Float[Array, "N v v"], h: Float[Array, "N v"], h_end: Float[Array, " n"]
) -> Factors:
    """Backward sweep of the steps dv from a trajectory that minimise 1/2 dv' H dv + h' dv.

    The steps obey dx_{j+1} = A dx_j + B du_j, dx_0 = 0.
    """
    n, p = qp.B.shape
    model = jnp.concatenate([qp.A, qp.B], axis=1)

    def back(behind, stage):
        P, q = behind
        H, h = stage
        T = H + model.T @ (P @ model)
        t = h + model.T @ q
        G = T[n:, n:]
        R = jnp.stack([jnp.stack(row) for row in cholesky(G)])
        Y, y = _eliminated(R, T[n:, :n]), _eliminated(R, t[n:])
        return (T[:n, :n] - Y.T @ Y, t[:n] - Y.T @ y), Factors(Y, y, R)

    return lax.scan(back, (qp.H_end, h_end), (H, h), reverse=True)[1]


def forward_sweep(qp: StagedQP, factors: Factors) -> Trajectory:
    """Forward sweep of the step, by the feedback law of a backward sweep."""
    p = qp.B.shape[1]

    def on(x, stage):
        u = -jnp.stack(returned(stage.R, stage.Y @ x + stage.y))
        return qp.A @ x + qp.B @ u, (x, u)

    end, (x, u) = lax.scan(on, jnp.zeros_like(qp.x0), factors)
    return Trajectory(jnp.concatenate([x, u.reshape(-1, p)], axis=1), end)


def resolved_step(
    qp: StagedQP, factors: Factors, h: Float[Array, "N v"], h_end: Float[Array, " n"]
) -> Trajectory:
    """The step for another h, from the factors of the same H; linear in h."""
    n = qp.x0.size
    model = jnp.concatenate([qp.A, qp.B], axis=1)

    def back(q, stage):
        h, Y, R = stage
        t = h + model.T @ q
        y = _eliminated(R, t[n:])
        return t[:n] - Y.T @ y, y

    y = lax.scan(back, h_end, (h, factors.Y, factors.R), reverse=True)[1]
    return forward_sweep(qp, factors._replace(y=y))


def gradient(qp: StagedQP, at: Trajectory) -> Trajectory:
    """Gradient of the cost in every v_j, and in x_N."""
    return Trajectory(
        jnp.einsum("jab,jb->ja", qp.H, at.stages) + qp.h, qp.H_end @ at.end + qp.h_end
    )


def plus(one: Trajectory, other: Trajectory) -> Trajectory:
    """Sum of two trajectories, or gradients."""
    return Trajectory(one.stages + other.stages, one.end + other.end)


def costates(qp: StagedQP, slope: Trajectory) -> Float[Array, "N n"]:
    """Multipliers of the model's equations, of x_1 to x_N, at which no state moves the Lagrangian.

    Args:
        qp: the problem.
        slope: of cost and limits.
    """
    n = qp.x0.size

    def back(costate, slope):
        return slope[:n] + qp.A.T @ costate, costate

    return lax.scan(back, slope.end, slope.stages, reverse=True)[1]


def free_response(
    qp: StagedQP, start: Float[Array, " n"], added: Float[Array, "N n"]
) -> tuple[Float[Array, "N n"], Float[Array, " n"]]:
    """States without controls from another start, with other numbers added."""
    return _simulated(qp, start, jnp.zeros((added.shape[0], qp.B.shape[1]), added.dtype), added)


def _simulated(qp: StagedQP, start, controls, added):
    def on(x, stage):
        u, c = stage
        return qp.A @ x + qp.B @ u + c, x

    end, x = lax.scan(on, start, (controls, added))
    return x, end


# A small matrix is worked on number by number: a `vmap` then makes loops over the batch of it.
# Divisions by the pivots are multiplications by what stands on the diagonal of R.


def _eliminated(R: Float[Array, "p p"], rows: Float[Array, "p *q"]) -> Float[Array, "p *q"]:
    return jnp.stack(eliminated(R, rows))


def cholesky(G) -> list[list]:
    """Rows of R of G = R'R, upper triangular, with the inverse of its diagonal in its place.

    Args:
        G: its rows; as for the functions below, lists of numbers or arrays do.
    """
    p = len(G)
    R: list[list] = [[0.0] * p for _ in range(p)]
    for i in range(p):
        R[i][i] = lax.rsqrt(G[i][i] - _sum(R[k][i] ** 2 for k in range(i)))
        for j in range(i + 1, p):
            R[i][j] = (G[i][j] - _sum(R[k][i] * R[k][j] for k in range(i))) * R[i][i]
    return R


def eliminated(R, rows) -> list:
    """Solution X of R' X = rows, by its rows."""
    solution: list[Array] = []
    for i in range(len(R)):
        solution.append((rows[i] - _sum(R[k][i] * solution[k] for k in range(i))) * R[i][i])
    return solution


def returned(R, values) -> list:
    """Solution x of R x = values."""
    p = len(R)
    solution: list[Array] = [values[0]] * p
    for i in reversed(range(p)):
        solution[i] = (values[i] - _sum(R[i][k] * solution[k] for k in range(i + 1, p))) * R[i][i]
    return solution


def _sum(terms):
    return sum(terms, start=0.0)


Numbers = Array  # of all limits


class Limits(NamedTuple):
    """Limits g' v <= b.

    Attributes:
        bound: b; zero where there is none.
        finite: whether there is one.
        soft: whether it gives way, at a price.
        price: of a unit beyond it; 1 where it does not.
        width: half of what lies between two limits, or the size of a single one.
    """

    bound: Numbers
    finite: Numbers
    soft: Numbers
    price: Numbers
    width: Numbers


class Point(NamedTuple):
    """A point of the path: the trajectory, and slacks s, t and multipliers l, g of the limits."""

    at: Any
    s: Numbers
    l: Numbers  # noqa: E741
    t: Numbers
    g: Numbers


class Direction(NamedTuple):
    """Search direction of slacks and multipliers."""

    s: Numbers
    l: Numbers  # noqa: E741
    t: Numbers
    g: Numbers


class Newton(NamedTuple):
    """Newton's equations of limits at a point."""

    primal_residual: Numbers  # of s + g' v - t = b
    price_residual: Numbers  # of l + g = r
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


def limit_values(qp: StagedQP, at: Trajectory):
    """Values g' v of the one-sided limits."""
    value = at.stages @ qp.D.T
    return jnp.stack([value, -value])


def limit_gradient(qp: StagedQP, multipliers) -> Trajectory:
    """Gradient G' l of the limits; none reaches the last state."""
    stages = (multipliers[0] - multipliers[1]) @ qp.D
    return Trajectory(stages, jnp.zeros_like(qp.x0))


def gram(qp: StagedQP, weight):
    """Sum of W d d' over the rows d of every stage."""
    v = qp.D.shape[1]
    squares = (qp.D[:, :, None] * qp.D[:, None, :]).reshape(-1, v * v)
    return (jnp.sum(weight, axis=0) @ squares).reshape(-1, v, v)


def first_point(at, slack: Numbers, mu: Numbers, limits: Limits, least: float) -> Point:
    """Slacks and multipliers to begin with: all products are mu.

    Args:
        at: the trajectory.
        slack: b - g' v of the limits there.
        mu: first value of the path's parameter.
        limits: the limits.
        least: of a limit's width that a slack begins with, at least.
    """
    s = jnp.where(limits.finite, jnp.maximum(slack, least * limits.width), 1.0)
    l = jnp.where(limits.finite, mu / s, 0.0)  # noqa: E741
    l = jnp.where(limits.soft, jnp.minimum(l, 0.5 * limits.price), l)  # noqa: E741
    g = jnp.where(limits.soft, limits.price - l, 1.0)
    return Point(at, s, l, jnp.where(limits.soft, mu / g, 0.0), g)


def newton(point: Point, limits: Limits, rows: Numbers) -> Newton:
    """Newton's equations of limits where g' v is `rows`."""
    _, s, l, t, g = point  # noqa: E741
    return Newton(
        primal_residual(point, limits, rows),
        jnp.where(limits.soft, l + g - limits.price, 0.0),
        jnp.where(limits.finite, l / softened_slack(point, limits), 0.0),
        jnp.where(limits.finite, 1 / l, 0.0),
        jnp.where(limits.soft, 1 / g, 0.0),
    )


def primal_residual(point: Point, limits: Limits, rows: Numbers) -> Numbers:
    """Residual of s + g' v - t = b."""
    return jnp.where(limits.finite, point.s + rows - point.t - limits.bound, 0.0)


def softened_slack(point: Point, limits: Limits) -> Numbers:
    """Slack over multiplier, times the multiplier: s + l t / g."""
    way = jnp.where(limits.soft, point.t / point.g, 0.0)
    return point.s + way * point.l


def predictor_products(point: Point, limits: Limits) -> tuple[Numbers, Numbers]:
    """Products s l and t g: c1 and c2 of a predictor, whose aim is zero."""
    return point.s * point.l, point.t * jnp.where(limits.soft, point.g, 0.0)


def corrector_products(
    point: Point, limits: Limits, steps: Direction, share, target
) -> tuple[Numbers, Numbers]:
    """Products c1 and c2 of a corrector: with those of the predictor's steps, less the aim."""
    c1, c2 = predictor_products(point, limits)
    c1 = jnp.where(limits.finite, c1 + share * steps.s * steps.l - target, 0.0)
    return c1, jnp.where(limits.soft, c2 + share * steps.t * steps.g - target, 0.0)


def constant_term(here: Newton, point: Point, limits: Limits, c1: Numbers, c2: Numbers) -> Numbers:
    """Constant term of dl = W (d + constant), from the residuals and the products."""
    way = (c2 - point.t * here.price_residual) * here.over_g
    return jnp.where(limits.finite, here.primal_residual - c1 * here.over_l + way, 0.0)


def direction(
    here: Newton, point: Point, limits: Limits, moved: Numbers, c1: Numbers, c2: Numbers
) -> Direction:
    """Changes with a step, `moved` is its change of g' v and the constant term."""
    dl = here.weight * moved
    ds = -(c1 + point.s * dl) * here.over_l
    dg = jnp.where(limits.soft, -here.price_residual - dl, 0.0)
    return Direction(ds, dl, -(c2 + point.t * dg) * here.over_g, dg)


def step_length(point: Point, steps: Direction, limits: Limits) -> Numbers:
    """Largest step length up to 1 that keeps each slack and multiplier positive."""
    longest: Any = 1.0
    for value, change, counts in (
        (point.s, steps.s, limits.finite),
        (point.l, steps.l, limits.finite),
        (point.t, steps.t, limits.soft),
        (point.g, steps.g, limits.soft),
    ):
        falls = counts & (change < 0)
        part = jnp.where(falls, -value / jnp.where(falls, change, 1.0), 1.0)
        longest = jnp.minimum(longest, part)
    return longest


def advanced(point: Point, at, steps: Direction, far) -> Point:
    """Point after a part of a step; `at` is its trajectory."""
    s, l, t, g = (now + far * step for now, step in zip(point[1:], steps, strict=True))  # noqa: E741
    return Point(at, s, l, t, g)


def gap(point: Point) -> Numbers:
    """Products s l + t g, limit by limit; g is 1 where t is zero."""
    return point.s * point.l + point.t * point.g
