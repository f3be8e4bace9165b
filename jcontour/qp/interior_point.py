"""Primal-dual interior point for `StagedQP`: traceable, batched by `vmap`, differentiable.

With a slack s >= 0 and a multiplier l >= 0 for every finite limit g' v <= b, Newton's method on

    H v + h + G' l = 0 along the model,    s + G v - t = b,    s l = mu
as mu goes to zero, with Mehrotra's predictor and corrector (SIAM J. Optimization 2, 1992). A limit
that gives way has t >= 0 beyond it, at a price r a unit, and g >= 0 with l + g = r, t g = mu. Each
step is one Riccati sweep with

    H + G' W G,    W = 1 / (s / l + t / g)
as of the linear-quadratic problem without limits (Rao, Wright & Rawlings, J. Optimization Theory
and Applications 99, 1998).

Derivative of the trajectory: by the implicit function theorem at the answer, with the last W: one
sweep. The equations above, mu held, give the multipliers' change

    dl = W (d(G v - b) + (t / g) dr):
beyond a limit all of its price's change, W t / g = 1 nearly. Where a limit is about to become
active the derivative is between those of either side. An answer that is not solved has NaN for a
derivative, in both directions.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jcontour.qp.staged import (
    Direction,
    Limits,
    Point,
    StagedQP,
    Trajectory,
    advanced,
    backward_sweep,
    constant_term,
    corrector_products,
    costates,
    direction,
    first_point,
    forward_sweep,
    free_response,
    gap,
    gradient,
    gram,
    limit_gradient,
    limit_values,
    newton,
    one_sided_limits,
    plus,
    predictor_products,
    primal_residual,
    resolved_step,
    rollout,
    softened_slack,
    step_length,
)

SOLVED = 1e-6  # largest scaled residual of an answer that counts as solved
MOST_ITERATIONS = 40  # iterations; 8 to 12 are usual
GAP = 1e-15  # mu over its largest value at which it ends: a weak limit is then off by 1e-7
LEAST_GAP = 2e-16  # where it ends even if rounding has left a limit's equation missed
LEAST_TARGET = 1e-16  # of mu: below, W is so large that rounding spoils the costate
NEAR_END = 1e-8  # mu over its largest value from where on a step may not spoil the costate
STATIONARITY = 5e-7  # residual, over its largest term: half of what counts as solved
FEASIBILITY = 1e-11  # residual of a limit's equation, over the limit's width
TO_BOUNDARY = 0.995  # fraction of the way to the nearest limit
LONG_STEP = 0.5  # length of a predictor step beyond which it is corrected in full
FIRST_SLACK = 0.5  # least first slack, over the limit's width
FIRST_MU = 10.0  # first mu, over what the limits could cost each of them
ROUNDINGS = 100  # of the terms of a slope before they cancel, that count as solved
# of a limit's width: so much larger are slacks in derivatives; with less, rounding hides H behind W
SOFTENED = 1e-6
TANGENT_PASSES = 4  # each reduces the effect of `SOFTENED` by that factor


class Answer(NamedTuple):
    """Answer to a problem."""

    trajectory: Trajectory  # the controls, and the states that they lead to
    # of the upper limits, and of the lower ones; zero where there is none
    multipliers: Float[Array, "2 N r"]
    # largest of three: what violates a limit, over the limit's width; what the Lagrangian's slope
    # with a control is, over the largest term in it; multipliers times slacks, over the terms of
    # the cost. Infinite where a limit or a penalty is none.
    residual: Float[Array, ""]
    solved: Bool[Array, ""]  # whether it is at most 1e-6; never where a number is not finite
    iterations: Int[Array, ""]  # until then
    beyond: Float[Array, ""]  # largest amount by which a limit that gives way is exceeded


def solve(qp: StagedQP, guess: Float[Array, "N p"] | None = None) -> Answer:
    """Answer to a problem; its trajectory has derivatives with respect to every number of it.

    The trajectory alone has them: those of the multipliers, of the residual and of `beyond` are
    zero. `beyond` follows from the trajectory, where its slope is needed.

    A problem without an answer, or with numbers that are not finite, is not `solved`: what its
    trajectory holds then means nothing, and its derivative is NaN.

    Args:
        qp: the problem.
        guess: controls to begin with; zero when not given. They change the last digits at most.

    Raises:
        ValueError: an array is of another size than h, B and D say.
    """
    (N, v), (n, p), r = jnp.shape(qp.h), jnp.shape(qp.B), len(qp.D)
    shapes = {
        "A": (n, n),
        "B": (n, p),
        "c": (N, n),
        "x0": (n,),
        "H": (N, v, v),
        "h": (N, n + p),
        "H_end": (n, n),
        "h_end": (n,),
        "D": (r, v),
        "lower": (N, r),
        "upper": (N, r),
        "penalty": (r,),
    }
    for name, shape in shapes.items():
        if jnp.shape(getattr(qp, name)) != shape:
            received = jnp.shape(getattr(qp, name))
            raise ValueError(f"qp.{name}: needs shape {shape}, received {received}")
    even = (qp.H + jnp.swapaxes(qp.H, 1, 2)) / 2, (qp.H_end + jnp.transpose(qp.H_end)) / 2
    qp = qp._replace(H=even[0], H_end=even[1])
    controls = shapes["h"][0], shapes["B"][1]
    guess = jnp.zeros(controls) if guess is None else jnp.asarray(guess)
    if guess.shape != controls:
        raise ValueError(f"guess: needs shape {controls}, received {guess.shape}")
    return _answer(qp, lax.stop_gradient(guess).astype(qp.h.dtype))


@jax.custom_jvp
def _answer(qp: StagedQP, guess: Float[Array, "N p"]) -> Answer:
    return _solved(qp, guess)[0]


@_answer.defjvp
def _answer_jvp(primals, tangents):
    qp, guess = primals
    answer, point, limits = _solved(qp, guess)
    step = _tangent(qp, answer, point, limits, tangents[0])
    known = jnp.where(answer.solved, 1.0, jnp.nan)  # a factor: slopes go through it both ways
    step = jax.tree.map(lambda change: change * known, step)
    zero = jax.tree.map(_zero_tangent, answer)
    return answer, zero._replace(trajectory=step)


def _zero_tangent(leaf: Array):
    if jnp.issubdtype(leaf.dtype, jnp.floating):
        return jnp.zeros_like(leaf)
    return jnp.zeros(leaf.shape, jax.dtypes.float0)


def _tangent(qp: StagedQP, answer: Answer, point: Point, limits: Limits, dqp) -> Trajectory:
    """Change of the trajectory with the numbers of the problem: linear in it."""
    at, multipliers = answer.trajectory, answer.multipliers
    costate = costates(qp, plus(gradient(qp, at), limit_gradient(qp, multipliers)))

    def equations(qp: StagedQP):
        model = jnp.concatenate([qp.A, qp.B], axis=1)
        slope = plus(gradient(qp, at), limit_gradient(qp, multipliers))
        slope = Trajectory(slope.stages + costate @ model, slope.end)
        moved = one_sided_limits(qp)
        value = jnp.where(limits.finite, limit_values(qp, at), 0.0) - moved.bound
        return slope, at.stages @ model.T + qp.c, value, moved.price, qp.x0

    _, (slope, added, value, price, start) = jax.jvp(equations, (qp,), (dqp,))
    weight, share, soft_share = _softened(point, limits)
    weighted = weight * value + soft_share * price
    H = qp.H + gram(qp, weight)
    x, end = free_response(qp, start, added)
    free = jnp.concatenate([x, jnp.zeros((x.shape[0], qp.B.shape[1]), x.dtype)], axis=1)
    h, h_end = slope.stages + jnp.einsum("jab,jb->ja", H, free), slope.end + qp.H_end @ end
    factors = backward_sweep(qp, H, jnp.zeros_like(h), jnp.zeros_like(h_end))

    def refine(_, carry):
        _, change = carry  # of the multipliers
        constant = weighted + share * change
        step = resolved_step(qp, factors, h + limit_gradient(qp, constant).stages, h_end)
        step = plus(step, Trajectory(free, end))
        return step, constant + weight * jnp.where(limits.finite, limit_values(qp, step), 0.0)

    nothing = Trajectory(jnp.zeros_like(free), jnp.zeros_like(end)), jnp.zeros_like(value)
    return lax.fori_loop(0, TANGENT_PASSES, refine, nothing)[0]


def _solved(qp: StagedQP, guess: Float[Array, "N p"]) -> tuple[Answer, Point, Limits]:
    limits = one_sided_limits(qp)
    point, iterations = _converged(qp, limits, guess)
    # the residuals are found anew
    n, l = qp.x0.size, point.l  # noqa: E741
    at = rollout(qp, point.at.stages[:, n:])
    over = jnp.where(limits.finite, limit_values(qp, at) - limits.bound, 0.0)
    beyond, left = jnp.maximum(over, 0.0), jnp.maximum(-over, 0.0)
    hard = jnp.max(jnp.where(limits.soft, 0.0, beyond / limits.width), initial=0.0)
    gives = jnp.where(limits.soft, beyond, 0.0)
    cost, dual, tiny = gradient(qp, at), _stationarity(qp, at, l), jnp.finfo(l.dtype).tiny ** 0.5
    costs = jnp.sum(jnp.abs(cost.stages * at.stages)) + jnp.sum(jnp.abs(cost.end * at.end))
    costs = jnp.maximum(costs, jnp.maximum(jnp.sum(l * jnp.abs(limits.bound)), tiny))
    gap = jnp.sum(l * left) + jnp.sum((limits.price - l) * gives)
    residual = jnp.maximum(hard, jnp.maximum(dual, gap / costs))
    # no limit may be NaN or crossed, and every penalty has to be one
    known = (qp.lower <= qp.upper) & (qp.lower < jnp.inf) & (qp.upper > -jnp.inf)
    residual = jnp.where(jnp.all(known) & jnp.all(qp.penalty > 0), residual, jnp.inf)
    most = jnp.max(gives, initial=0.0)
    return Answer(at, l, residual, residual <= SOLVED, iterations, most), point, limits


def _converged(qp: StagedQP, limits: Limits, guess) -> tuple[Point, Array]:
    """Last point of the path, and iterations."""
    count = jnp.maximum(jnp.sum(limits.finite, dtype=qp.x0.dtype), 1)
    first, mu0 = _start(qp, guess, limits, count)

    def unfinished(state):
        point, k, finite, largest, _ = state
        # the path's mu, and the largest miss of an equation of a limit, over the limit's width
        missed = jnp.abs(primal_residual(point, limits, limit_values(qp, point.at))) / limits.width
        mu, missed = _total(point) / count, jnp.max(missed, initial=0.0)
        later = (missed > FEASIBILITY) & (mu > LEAST_GAP * largest)
        return finite & (k < MOST_ITERATIONS) & ((mu > GAP * largest) | later)

    def iterate(state):
        point, k, _, largest, before = state
        following = _iterated(qp, point, limits, count, largest)
        total = _total(following)
        # near the end W is so large that rounding may leave no factors, or bad ones: the point
        # before is kept
        near = _total(point) < NEAR_END * count * largest
        after = _stationarity(qp, following.at, following.l)
        worse = near & (after > jnp.maximum(before, STATIONARITY))
        accepted = jnp.isfinite(total + jnp.sum(following.at.stages)) & ~worse
        next_point = jax.tree.map(partial(jnp.where, accepted), following, point)
        # mu grows where a limit gives way at a price that no cost without limits hints at
        largest = jnp.maximum(largest, jnp.where(accepted, total / count, 0.0))
        return next_point, k + 1, accepted, largest, after

    begun = first, jnp.asarray(0), jnp.asarray(True), mu0, jnp.full_like(mu0, jnp.inf)
    unlimited = qp.D.shape[0] == 0  # nothing to iterate, and nothing to compile
    point, k, *_ = begun if unlimited else lax.while_loop(unfinished, iterate, begun)
    return point, k


def _start(qp: StagedQP, guess, limits: Limits, count) -> tuple[Point, Array]:
    """The guess, with mu from what leads from there to the minimum without limits."""
    # where the minimum without limits is within them it is the answer, and no iteration follows
    at = rollout(qp, guess)
    slope = gradient(qp, at)
    free = forward_sweep(qp, backward_sweep(qp, qp.H, *slope))
    gain = -0.5 * (jnp.sum(slope.stages * free.stages) + slope.end @ free.end)
    tiny = jnp.finfo(gain.dtype).tiny ** 0.5
    mu = jnp.maximum(FIRST_MU * gain / count, tiny)
    slack = limits.bound - limit_values(qp, at)
    first = first_point(at, slack, mu, limits, FIRST_SLACK)
    without = Trajectory(at.stages + free.stages, at.end + free.end)
    slack = limits.bound - limit_values(qp, without)
    within = jnp.all(jnp.where(limits.finite, slack > 0, True))
    nothing = jnp.zeros_like(slack)
    answer = Point(without, jnp.where(limits.finite, slack, 1.0), nothing, nothing, limits.price)
    return jax.tree.map(lambda one, other: jnp.where(within, one, other), answer, first), mu


def _iterated(qp: StagedQP, point: Point, limits: Limits, count, largest) -> Point:
    """Predictor, corrector, and the step that both share the matrix of."""
    at = point.at
    slope, here = gradient(qp, at), newton(point, limits, limit_values(qp, at))
    mu = _total(point) / count

    def right(constant):
        return plus(slope, limit_gradient(qp, point.l + here.weight * constant))

    def steps(step: Trajectory, constant, targets):
        moved = jnp.where(limits.finite, limit_values(qp, step), 0.0) + constant
        return direction(here, point, limits, moved, *targets)

    targets = predictor_products(point, limits)
    constant = constant_term(here, point, limits, *targets)
    factors = backward_sweep(qp, qp.H + gram(qp, here.weight), *right(constant))
    first = steps(forward_sweep(qp, factors), constant, targets)
    alpha = _largest_step(point, first, limits)
    predicted = _total(advanced(point, at, first, alpha))
    target = jnp.clip(predicted / (count * mu), 0.0, 1.0) ** 3 * mu
    target = jnp.maximum(target, LEAST_TARGET * largest)
    share = jnp.where(alpha > LONG_STEP, 1.0, alpha)  # where little of the step was possible
    targets = corrector_products(point, limits, first, share, target)
    constant = constant_term(here, point, limits, *targets)
    step = resolved_step(qp, factors, *right(constant))
    second = steps(step, constant, targets)
    alpha = _largest_step(point, second, limits)
    alpha = jnp.where(alpha < 1, TO_BOUNDARY * alpha, 1.0)
    moved = Trajectory(at.stages + alpha * step.stages, at.end + alpha * step.end)
    return advanced(point, moved, second, alpha)


def _largest_step(point: Point, steps: Direction, limits: Limits):
    """Part of a step, at most all, after which every slack and multiplier is still positive."""
    return jnp.min(step_length(point, steps, limits), initial=1.0)


def _total(point: Point):
    return jnp.sum(gap(point))


def _stationarity(qp: StagedQP, at: Trajectory, multipliers) -> Float[Array, ""]:
    """Largest slope of the Lagrangian with a control, over the largest term in it."""
    n = qp.x0.size
    cost, limited = gradient(qp, at), limit_gradient(qp, multipliers)
    costate = costates(qp, plus(cost, limited))
    terms = cost.stages[:, n:], limited.stages[:, n:], costate @ qp.B
    apart = qp.h[:, n:], costates(qp, Trajectory(qp.h, qp.h_end)) @ qp.B
    scale = _largest(terms), _rounding(multipliers.dtype) * _largest(apart)
    tiny = jnp.finfo(multipliers.dtype).tiny ** 0.5
    return jnp.max(jnp.abs(sum(terms))) / jnp.maximum(jnp.maximum(*scale), tiny)


def _rounding(dtype) -> float:
    """Least scale of a slope, over its terms before they cancel."""
    # at rest in its place the slopes H v and h of a machine cancel to the last digits: a slope of
    # `ROUNDINGS` of these has the residual `SOLVED`
    return ROUNDINGS * float(np.finfo(dtype).eps) / SOLVED


def _largest(terms) -> Float[Array, ""]:
    return jnp.max(jnp.abs(jnp.stack(terms)))


def _softened(point: Point, limits: Limits):
    """W with larger slacks, the share of these that was added, and W t / g."""
    more = SOFTENED * limits.width
    slack = softened_slack(point, limits) + more
    there = limits.finite
    way = point.t * point.l
    ratio = way / (point.g * (point.s + more) + way)  # W t / g, also where rounding leaves no g
    return jnp.where(there, point.l / slack, 0.0), jnp.where(there, more / slack, 0.0), ratio
