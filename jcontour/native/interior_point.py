"""Iterations of `jcontour.qp.interior_point` on the CPU, eight problems at a time.

The equations, the order and the tests of the readable solver, with every loop over stages in one
call: one thirtieth part of the operations that XLA calls one by one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy import intp  # a literal would be a type of its own, compiled once more

from jcontour.native.calls import argument, asks, extent, native_call, result
from jcontour.native.lanes import (
    WIDTH,
    fma,
    gathered,
    load,
    part,
    scatter,
    spread,
    store,
    where_less,
)
from jcontour.native.staged import (
    Factors,
    Path,
    Problem,
    Sizes,
    add_row,
    factorise,
    move,
    non_zeros,
    roll_out,
    row_of,
    slope_at,
    step_of,
)
from jcontour.qp.one_sided import Point
from jcontour.qp.path import (
    CLOSE,
    CLOSEST,
    FAR,
    FIRST,
    INWARD,
    MISSED,
    MOST,
    ROOM,
)
from jcontour.qp.staged import Trajectory

TINY = float(np.finfo(float).tiny ** 0.5)


class Limits(NamedTuple):
    """Limits of eight problems as one-sided ones, as in the readable solver.

    `there` and `gives` are 1 or 0, `number` counts limits, `some_give` is whether any gives way.
    """

    bound: np.ndarray
    there: np.ndarray
    gives: np.ndarray
    price: np.ndarray
    width: np.ndarray
    number: np.ndarray
    some_give: bool


class Slacks(NamedTuple):
    """s, l, t and g of every limit, or what changes them."""

    s: np.ndarray
    l: np.ndarray  # noqa: E741
    t: np.ndarray
    g: np.ndarray


class Linear(NamedTuple):
    """Newton's equations of every limit: inverses, W, what is missed, and the right sides."""

    over_s: np.ndarray
    over_l: np.ndarray
    over_t: np.ndarray
    over_g: np.ndarray
    weight: np.ndarray
    missed: np.ndarray
    price_missed: np.ndarray
    pushed: np.ndarray
    c1: np.ndarray
    c2: np.ndarray


@part
def _least(one, other):
    return where_less(other, one, other, one)


@part
def _most(one, other):
    return where_less(one, other, other, one)


@part
def _counted(there, gives, size):
    """Number of limits of every lane, at least 1, and whether any gives way."""
    number, some = np.zeros(WIDTH), False
    for k in range(size):
        for lane in range(WIDTH):
            number[lane] += there[k * WIDTH + lane]
            some = some or gives[k * WIDTH + lane] > 0.5
    store(number, 0, _most(load(number, 0), spread(1.0)))
    return number, some


@part
def _begin(problem, sizes, limits, path, step, slope, factors, now):
    """First slacks and multipliers, or the minimum without limits where it is within: mu."""
    half, zero, one = spread(0.5), spread(0.0), spread(1.0)
    N, n, v, r = sizes.N, sizes.n, sizes.v, sizes.r
    roll_out(problem, sizes, path)
    slope_at(problem, sizes, path, slope)
    factorise(problem, sizes, np.zeros(N * r * WIDTH), factors)
    step_of(problem, sizes, factors, slope, step)
    gain = zero
    for k in range(N * v):
        gain = fma(load(slope.stages, k), load(step.stages, k), gain)
    for k in range(n):
        gain = fma(load(slope.end, k), load(step.end, k), gain)
    mu = spread(-0.5 * FIRST) * gain / load(limits.number, 0)
    mu = where_less(mu, spread(TINY), spread(TINY), mu)
    room, inside = np.empty(2 * N * r * WIDTH), one
    for k in range(2 * N * r):
        sign = one if k < N * r else spread(-1.0)
        j, row = k // r % N, k % r
        there, gives = load(limits.there, k), load(limits.gives, k)
        slack = load(limits.bound, k) - sign * row_of(problem, sizes, path, j, row)
        left = slack - sign * row_of(problem, sizes, step, j, row)
        store(room, k, left)
        inside = where_less(half, there, inside * where_less(zero, left, one, zero), inside)
        s = where_less(half, there, _most(slack, spread(ROOM) * load(limits.width, k)), one)
        price, l = load(limits.price, k), where_less(half, there, mu / s, zero)  # noqa: E741
        l = where_less(half, gives, _least(l, half * price), l)  # noqa: E741
        g = where_less(half, gives, price - l, one)
        store(now.s, k, s)
        store(now.l, k, l)
        store(now.g, k, g)
        store(now.t, k, where_less(half, gives, mu / g, zero))
    for k in range(2 * N * r):
        free = where_less(half, load(limits.there, k), load(room, k), one)
        store(now.s, k, where_less(half, inside, free, load(now.s, k)))
        store(now.l, k, where_less(half, inside, zero, load(now.l, k)))
        store(now.t, k, where_less(half, inside, zero, load(now.t, k)))
        store(now.g, k, where_less(half, inside, load(limits.price, k), load(now.g, k)))
    move(path, step, one, inside, N * v, n)
    return mu


@part
def _progress(problem, sizes, limits, path, now, linear):
    """The path's mu, and the largest miss of a limit's equation; each miss is kept."""
    half, zero, one = spread(0.5), spread(0.0), spread(1.0)
    N, r = sizes.N, sizes.r
    gap, largest = zero, zero
    for k in range(2 * N * r):
        sign = one if k < N * r else spread(-1.0)
        s, t = load(now.s, k), load(now.t, k)
        gap = gap + s * load(now.l, k) + t * load(now.g, k)
        value = sign * row_of(problem, sizes, path, k // r % N, k % r)
        missed = where_less(
            half, load(limits.there, k), s + value - t - load(limits.bound, k), zero
        )
        store(linear.missed, k, missed)
        largest = _most(largest, _most(missed, zero - missed) / load(limits.width, k))
    return gap / load(limits.number, 0), largest


@part
def _linearise(problem, sizes, limits, now, linear, right):
    """Inverses, W and the predictor's right side, the slope of the cost being in it already."""
    half, zero, one = spread(0.5), spread(0.0), spread(1.0)
    N, r = sizes.N, sizes.r
    for k in range(2 * N * r):
        there = load(limits.there, k)
        s, l = load(now.s, k), load(now.l, k)  # noqa: E741
        over_l = where_less(half, there, one / l, zero)
        store(linear.over_s, k, one / s)
        store(linear.over_l, k, over_l)
        slack, more, c1, c2 = s, zero, s * l, zero
        if limits.some_give:
            gives, t, g = load(limits.gives, k), load(now.t, k), load(now.g, k)
            over_g = where_less(half, gives, one / g, zero)
            price_missed = where_less(half, gives, l + g - load(limits.price, k), zero)
            store(linear.over_t, k, where_less(half, gives, one / t, zero))
            store(linear.over_g, k, over_g)
            store(linear.price_missed, k, price_missed)
            c2 = where_less(half, gives, t * g, zero)
            slack = s + t * over_g * l
            more = (c2 - t * price_missed) * over_g
        weight = where_less(half, there, l / slack, zero)
        pushed = where_less(half, there, load(linear.missed, k) - c1 * over_l + more, zero)
        store(linear.weight, k, weight)
        store(linear.pushed, k, pushed)
        store(linear.c1, k, c1)
        store(linear.c2, k, c2)
        _push(problem, sizes, right, k, l + weight * pushed)


@part
def _push(problem, sizes, right, k, multiplier):
    """Add what a limit's multiplier pulls to a slope."""
    sign = spread(1.0) if k < sizes.N * sizes.r else spread(-1.0)
    add_row(problem, sizes, right, k // sizes.r % sizes.N, k % sizes.r, sign * multiplier)


@part
def _changes(problem, sizes, limits, now, linear, step, change):
    """Changes of slacks and multipliers with a step: the part of it that keeps them positive."""
    half, zero, one = spread(0.5), spread(0.0), spread(1.0)
    N, r = sizes.N, sizes.r
    nearest = one  # inverse of the part
    for k in range(2 * N * r):
        sign = one if k < N * r else spread(-1.0)
        there, s = load(limits.there, k), load(now.s, k)
        over_l, weight = load(linear.over_l, k), load(linear.weight, k)
        value = sign * row_of(problem, sizes, step, k // r % N, k % r)
        dl = weight * (where_less(half, there, value, zero) + load(linear.pushed, k))
        ds = zero - (load(linear.c1, k) + s * dl) * over_l
        store(change.s, k, ds)
        store(change.l, k, dl)
        nearest = _most(nearest, where_less(half, there, zero - ds * load(linear.over_s, k), zero))
        nearest = _most(nearest, zero - dl * over_l)
        if limits.some_give:
            over_g, gives = load(linear.over_g, k), load(limits.gives, k)
            dg = where_less(half, gives, zero - load(linear.price_missed, k) - dl, zero)
            dt = zero - (load(linear.c2, k) + load(now.t, k) * dg) * over_g
            store(change.t, k, dt)
            store(change.g, k, dg)
            nearest = _most(nearest, zero - dt * load(linear.over_t, k))
            nearest = _most(nearest, zero - dg * over_g)
    return one / nearest


@part
def _gap_ahead(limits, now, change, far, size):
    """Sum of s l and t g after a part of the changes."""
    gap = spread(0.0)
    for k in range(size):
        s = fma(far, load(change.s, k), load(now.s, k))
        gap = fma(s, fma(far, load(change.l, k), load(now.l, k)), gap)
        if limits.some_give:
            t = fma(far, load(change.t, k), load(now.t, k))
            gap = fma(t, fma(far, load(change.g, k), load(now.g, k)), gap)
    return gap


@part
def _correct(problem, sizes, limits, now, linear, change, target, share, right):
    """The corrector's right side, the slope of the cost being in it already."""
    half, zero = spread(0.5), spread(0.0)
    for k in range(2 * sizes.N * sizes.r):
        there, l = load(limits.there, k), load(now.l, k)  # noqa: E741
        product = load(now.s, k) * l + share * load(change.s, k) * load(change.l, k)
        c1, c2, more = where_less(half, there, product - target, zero), zero, zero
        if limits.some_give:
            t = load(now.t, k)
            product = t * load(now.g, k) + share * load(change.t, k) * load(change.g, k)
            c2 = where_less(half, load(limits.gives, k), product - target, zero)
            more = (c2 - t * load(linear.price_missed, k)) * load(linear.over_g, k)
        pushed = load(linear.missed, k) - c1 * load(linear.over_l, k) + more
        pushed = where_less(half, there, pushed, zero)
        store(linear.c1, k, c1)
        store(linear.c2, k, c2)
        store(linear.pushed, k, pushed)
        _push(problem, sizes, right, k, l + load(linear.weight, k) * pushed)


@part
def _go(limits, now, change, far, moves, size):
    """Change slacks and multipliers by a part where `moves` is 1."""
    half = spread(0.5)
    for k in range(size):
        s, l = load(now.s, k), load(now.l, k)  # noqa: E741
        store(now.s, k, where_less(half, moves, fma(far, load(change.s, k), s), s))
        store(now.l, k, where_less(half, moves, fma(far, load(change.l, k), l), l))
        if limits.some_give:
            t, g = load(now.t, k), load(now.g, k)
            store(now.t, k, where_less(half, moves, fma(far, load(change.t, k), t), t))
            store(now.g, k, where_less(half, moves, fma(far, load(change.g, k), g), g))


@part
def _any(flags):
    found = False
    for lane in range(WIDTH):
        found = found or flags[lane] > 0.5
    return found


@part
def _both_sides(linear, both, half_size):
    """W of the upper limits and of the lower ones together."""
    for k in range(half_size):
        store(both, k, load(linear.weight, k) + load(linear.weight, half_size + k))


@part
def _copy(slope, right, length, n):
    for k in range(length):
        store(right.stages, k, load(slope.stages, k))
    for k in range(n):
        store(right.end, k, load(slope.end, k))


@part
def _path(sizes):
    return Path(np.zeros(sizes.N * sizes.v * WIDTH), np.zeros(sizes.n * WIDTH))


@part
def _rows(size):
    return np.zeros(size * WIDTH)


@part
def _iterate(problem, sizes, limits, path, now, iterations):
    """Newton's steps until every lane is at an end, or after the most there may be."""
    half, zero, one = spread(0.5), spread(0.0), spread(1.0)
    N, n, p, v = sizes.N, sizes.n, sizes.p, sizes.v
    size = 2 * N * sizes.r
    step, slope, right = _path(sizes), _path(sizes), _path(sizes)
    change = Slacks(_rows(size), _rows(size), _rows(size), _rows(size))
    linear = Linear(
        _rows(size),
        _rows(size),
        _rows(size),
        _rows(size),
        _rows(size),
        _rows(size),
        _rows(size),
        _rows(size),
        _rows(size),
        _rows(size),
    )
    both = np.empty(N * sizes.r * WIDTH)
    Y, y = np.empty(N * p * n * WIDTH), np.empty(N * p * WIDTH)
    factors = Factors(Y, y, np.empty(N * p * p * WIDTH))
    number, goes_on, unfinished = load(limits.number, 0), one, np.empty(WIDTH)
    largest = _begin(problem, sizes, limits, path, step, slope, factors, now)
    for _ in range(MOST):
        mu, missed = _progress(problem, sizes, limits, path, now, linear)
        later = where_less(spread(MISSED), missed, one, zero)
        later = where_less(spread(CLOSEST) * largest, mu, later, zero)
        open_ = where_less(spread(CLOSE) * largest, mu, one, later) * goes_on
        store(unfinished, 0, open_)
        if not _any(unfinished):
            break
        store(iterations, 0, load(iterations, 0) + open_)
        slope_at(problem, sizes, path, slope)
        _copy(slope, right, N * v, n)
        _linearise(problem, sizes, limits, now, linear, right)
        _both_sides(linear, both, N * sizes.r)
        factorise(problem, sizes, both, factors)
        step_of(problem, sizes, factors, right, step)
        far = _changes(problem, sizes, limits, now, linear, step, change)
        left = _gap_ahead(limits, now, change, far, size) / (number * mu)
        left = _least(_most(left, zero), one)
        share = where_less(spread(FAR), far, one, far)
        _copy(slope, right, N * v, n)
        target = left * left * left * mu
        _correct(problem, sizes, limits, now, linear, change, target, share, right)
        step_of(problem, sizes, factors, right, step)
        far = _changes(problem, sizes, limits, now, linear, step, change)
        far = where_less(far, one, spread(INWARD) * far, one)
        gap = _gap_ahead(limits, now, change, far, size)
        total = gap
        for k in range(N * v):
            total = total + fma(far, load(step.stages, k), load(path.stages, k))
        # inf and NaN less themselves are NaN, which is less than nothing
        goes_on = goes_on * where_less(total - total, one, one, zero)
        moves = open_ * goes_on
        largest = where_less(half, moves, _most(largest, gap / number), largest)
        move(path, step, far, moves, N * v, n)
        _go(limits, now, change, far, moves, size)


@part
def _of(frame, k, first, count, size):
    return gathered(argument(frame, k), first, count, size)


@part
def _problem(frame, sizes, first, count):
    N, n, v = sizes.N, sizes.n, sizes.v
    D = _of(frame, intp(7), first, count, sizes.r * v)
    places, used = non_zeros(D, sizes)
    return Problem(
        _of(frame, intp(0), first, count, n * v),
        _of(frame, intp(1), first, count, N * n),
        _of(frame, intp(2), first, count, n),
        _of(frame, intp(3), first, count, N * v * v),
        _of(frame, intp(4), first, count, N * v),
        _of(frame, intp(5), first, count, n * n),
        _of(frame, intp(6), first, count, n),
        D,
        places,
        used,
    )


@part
def _limits(frame, size, first, count):
    there, gives = _of(frame, intp(9), first, count, size), _of(frame, intp(10), first, count, size)
    number, some_give = _counted(there, gives, size)
    return Limits(
        _of(frame, intp(8), first, count, size),
        there,
        gives,
        _of(frame, intp(11), first, count, size),
        _of(frame, intp(12), first, count, size),
        number,
        some_give,
    )


@part
def _eight(frame, sizes, first, count):
    """Solve the problems from `first` on, as many as there are lanes."""
    N, n, p, v = sizes.N, sizes.n, sizes.p, sizes.v
    size = 2 * N * sizes.r
    problem, limits = _problem(frame, sizes, first, count), _limits(frame, size, first, count)
    path, guess = _path(sizes), _of(frame, intp(13), first, count, N * p)
    for j in range(N):
        for k in range(p):
            store(path.stages, j * v + n + k, load(guess, j * p + k))
    now, iterations = Slacks(_rows(size), _rows(size), _rows(size), _rows(size)), _rows(intp(1))
    _iterate(problem, sizes, limits, path, now, iterations)
    scatter(path.stages, result(frame, intp(0)), first, count, N * v)
    scatter(path.end, result(frame, intp(1)), first, count, n)
    scatter(now.s, result(frame, intp(2)), first, count, size)
    scatter(now.l, result(frame, intp(3)), first, count, size)
    scatter(now.t, result(frame, intp(4)), first, count, size)
    scatter(now.g, result(frame, intp(5)), first, count, size)
    scatter(iterations, result(frame, intp(6)), first, count, intp(1))


@native_call("jcontour_interior_point")
def _call(frame):
    if asks(frame):
        return 0
    n, v = extent(frame, intp(0), intp(2)), extent(frame, intp(0), intp(1))
    sizes = Sizes(extent(frame, intp(4), intp(2)), n, v - n, v, extent(frame, intp(7), intp(2)))
    count = len(argument(frame, intp(2))) // n
    for first in range(0, count, WIDTH):
        _eight(frame, sizes, first, count)
    return 0


def converged(qp, limits, guess) -> tuple[Point, jax.Array]:
    """Last point of the path, and iterations, as the readable solver finds them.

    Args:
        qp: `StagedQP` of float64 numbers, with one limited row at least.
        limits: its limits as one-sided ones.
        guess: controls to begin with.
    """
    N, r = qp.lower.shape
    v, n = qp.h.shape[1], qp.x0.size

    def shape(*extents):
        return jax.ShapeDtypeStruct(extents, jnp.float64)

    shapes = [shape(N, v), shape(n), *(shape(2, N, r) for _ in range(4)), shape(1)]
    model = jnp.concatenate([qp.A, qp.B], axis=1)
    numbers = model, qp.c, qp.x0, qp.H, qp.h, qp.H_end, qp.h_end, qp.D
    flags = limits.there.astype(float), limits.gives.astype(float)
    stages, end, s, l, t, g, iterations = _call(  # noqa: E741
        shapes, *numbers, limits.bound, *flags, limits.price, limits.width, guess
    )
    return Point(Trajectory(stages, end), s, l, t, g), iterations[0].astype(int)
