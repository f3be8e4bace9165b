"""Limits of `jcontour.qp.one_sided` over lanes: Newton's equations of each, eight problems at once.

Upper limits come before lower ones; entry (side N + j) r + k is that of row k at stage j.
"""

from typing import NamedTuple

import numpy as np

from jcontour.native.lanes import WIDTH, fma, load, most, part, size_of, spread, store, where_less
from jcontour.qp.native.staged import add_row, row_of


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
def counted(there, gives, size):
    """Number of limits of every lane, at least 1, and whether any gives way."""
    number, some = np.zeros(WIDTH), False
    for k in range(size):
        for lane in range(WIDTH):
            number[lane] += there[k * WIDTH + lane]
            some = some or gives[k * WIDTH + lane] > 0.5
    store(number, 0, most(load(number, 0), spread(1.0)))
    return number, some


@part
def progress(problem, sizes, limits, path, now, linear):
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
        largest = most(largest, size_of(missed) / load(limits.width, k))
    return gap / load(limits.number, 0), largest


@part
def linearise(problem, sizes, limits, now, linear, right):
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
        push(problem, sizes, right, k, l + weight * pushed)


@part
def push(problem, sizes, right, k, multiplier):
    """Add what a limit's multiplier pulls to a slope."""
    sign = spread(1.0) if k < sizes.N * sizes.r else spread(-1.0)
    add_row(problem, sizes, right, k // sizes.r % sizes.N, k % sizes.r, sign * multiplier)


@part
def changes(problem, sizes, limits, now, linear, step, change):
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
        nearest = most(nearest, where_less(half, there, zero - ds * load(linear.over_s, k), zero))
        nearest = most(nearest, zero - dl * over_l)
        if limits.some_give:
            over_g, gives = load(linear.over_g, k), load(limits.gives, k)
            dg = where_less(half, gives, zero - load(linear.price_missed, k) - dl, zero)
            dt = zero - (load(linear.c2, k) + load(now.t, k) * dg) * over_g
            store(change.t, k, dt)
            store(change.g, k, dg)
            nearest = most(nearest, zero - dt * load(linear.over_t, k))
            nearest = most(nearest, zero - dg * over_g)
    return one / nearest


@part
def gap_ahead(limits, now, change, far, size):
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
def correct(problem, sizes, limits, now, linear, change, target, share, right):
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
        push(problem, sizes, right, k, l + load(linear.weight, k) * pushed)


@part
def go(limits, now, change, far, moves, size):
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
def both_sides(linear, both, half_size):
    """W of the upper limits and of the lower ones together."""
    for k in range(half_size):
        store(both, k, load(linear.weight, k) + load(linear.weight, half_size + k))
