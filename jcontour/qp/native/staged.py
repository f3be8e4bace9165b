"""Sweeps of `jcontour.qp.staged` over lanes: eight problems at once, number for number the same.

Arrays of lanes (`lanes`), row by row: M = (A B) of n x v, H of N x v x v, trajectories of N x v.
"""

from typing import NamedTuple

import numpy as np
from numpy import intp  # a literal would be a type of its own, compiled once more

from jcontour.native.lanes import (
    WIDTH,
    add_products,
    dot,
    fma,
    load,
    most,
    part,
    root,
    size_of,
    spread,
    store,
    where_less,
)


class Sizes(NamedTuple):
    """Stages N, states n, controls p, numbers of a stage v = n + p, and limited rows r."""

    N: int
    n: int
    p: int
    v: int
    r: int


class Problem(NamedTuple):
    """Numbers of eight `StagedQP`s; `places` has the entries of each row of D, `used` how many."""

    M: np.ndarray
    c: np.ndarray
    x0: np.ndarray
    H: np.ndarray
    h: np.ndarray
    H_end: np.ndarray
    h_end: np.ndarray
    D: np.ndarray
    places: np.ndarray
    used: np.ndarray


class Path(NamedTuple):
    """Numbers of every stage, and of the last state: a trajectory, a step, a slope."""

    stages: np.ndarray
    end: np.ndarray


class Factors(NamedTuple):
    """Y, y and R of `jcontour.qp.staged.Factors`."""

    Y: np.ndarray
    y: np.ndarray
    R: np.ndarray


@part
def non_zeros(D, sizes):
    """Entries of every row of D that are not zero in all lanes, and how many."""
    places, used = np.empty(sizes.r * sizes.v, np.int64), np.zeros(sizes.r, np.int64)
    for k in range(sizes.r):
        for a in range(sizes.v):
            there = False
            for lane in range(WIDTH):
                there = there or D[(k * sizes.v + a) * WIDTH + lane] != 0.0
            if there:
                places[k * sizes.v + used[k]] = a
                used[k] += 1
    return places, used


@part
def roll_out(problem, sizes, path):
    """States that the controls of a path lead to, written beside them."""
    N, n, v = sizes.N, sizes.n, sizes.v
    for a in range(n):
        store(path.stages, a, load(problem.x0, a))
    for j in range(N):
        for a in range(n):
            x = dot(problem.M, a * v, path.stages, j * v, v, load(problem.c, j * n + a))
            if j + 1 < N:
                store(path.stages, (j + 1) * v + a, x)
            else:
                store(path.end, a, x)


@part
def slope_at(problem, sizes, path, slope):
    """Slope of the cost along a path."""
    v, n = sizes.v, sizes.n
    for j in range(sizes.N):
        for a in range(v):
            h = load(problem.h, j * v + a)
            store(
                slope.stages, j * v + a, dot(problem.H, (j * v + a) * v, path.stages, j * v, v, h)
            )
    for a in range(n):
        store(slope.end, a, dot(problem.H_end, a * n, path.end, intp(0), n, load(problem.h_end, a)))


@part
def factorise(problem, sizes, weight, factors):
    """Backward sweep of H + D' W D, W by stage and row (`N r`); `y` is left to `step_of`."""
    N, n, p, v = sizes.N, sizes.n, sizes.p, sizes.v
    P, T = np.empty(n * n * WIDTH), np.empty(v * v * WIDTH)
    nothing, PM = np.zeros(n * v * WIDTH), np.empty(n * v * WIDTH)
    plus, minus = spread(1.0), spread(-1.0)
    origin, on, M, Y = intp(0), intp(1), problem.M, factors.Y
    for k in range(n * n):
        store(P, k, load(problem.H_end, k))
    for back in range(N):
        j = N - 1 - back
        for a in range(n):
            add_products(PM, a * v, nothing, origin, P, a * n, on, plus, M, origin, v, n, v)
        for a in range(v):
            at = (j * v + a) * v
            lower = min(v, (a + 4) // 4 * 4)  # up to the diagonal, in whole groups of columns
            add_products(T, a * v, problem.H, at, M, a, v, plus, PM, origin, v, n, lower)
        _add_gram(problem, sizes, weight, j, T)
        for i in range(p):
            _eliminate(sizes, j, i, T, factors)
        for a in range(n):
            lower = min(n, (a + 4) // 4 * 4)
            first = j * p * n
            add_products(P, a * n, T, a * v, Y, first + a, n, minus, Y, first, n, p, lower)
        for a in range(n):
            for b in range(a):
                store(P, b * n + a, load(P, a * n + b))


@part
def _add_gram(problem, sizes, weight, j, T):
    """Add D' W D of a stage to the lower triangle."""
    v, D = sizes.v, problem.D
    for k in range(sizes.r):
        W = load(weight, j * sizes.r + k)
        for first in range(problem.used[k]):
            a = problem.places[k * v + first]
            factor = W * load(D, k * v + a)
            for second in range(first + 1):
                b = problem.places[k * v + second]
                store(T, a * v + b, fma(factor, load(D, k * v + b), load(T, a * v + b)))


@part
def _eliminate(sizes, j, i, T, factors):
    """Row i of R and of Y at stage j."""
    n, p, v = sizes.n, sizes.p, sizes.v
    Y, R, first = factors.Y, factors.R, j * p * p
    pivot = load(T, (n + i) * v + n + i)
    for k in range(i):
        entry = load(R, first + k * p + i)
        pivot = pivot - entry * entry
    inverse = spread(1.0) / root(pivot)
    store(R, first + i * p + i, inverse)
    for b in range(i + 1, p):
        entry = load(T, (n + b) * v + n + i)
        for k in range(i):
            entry = entry - load(R, first + k * p + i) * load(R, first + k * p + b)
        store(R, first + i * p + b, entry * inverse)
    row, minus = (j * p + i) * n, spread(-1.0)
    add_products(Y, row, T, (n + i) * v, R, first + i, p, minus, Y, j * p * n, n, i, n)
    for b in range(n):
        store(Y, row + b, load(Y, row + b) * inverse)


@part
def step_of(problem, sizes, factors, slope, step):
    """The step that minimises 1/2 dv' H dv + slope' dv along the model, from the factors of H."""
    N, n, p, v = sizes.N, sizes.n, sizes.p, sizes.v
    origin, on = intp(0), intp(1)
    M, Y, y, R = problem.M, factors.Y, factors.y, factors.R
    q, t = np.empty(n * WIDTH), np.empty(v * WIDTH)
    plus, minus, zero = spread(1.0), spread(-1.0), spread(0.0)
    for a in range(n):
        store(q, a, load(slope.end, a))
    for back in range(N):
        j = N - 1 - back
        add_products(t, origin, slope.stages, j * v, q, origin, on, plus, M, origin, v, n, v)
        for i in range(p):
            entry = load(t, n + i)
            for k in range(i):
                entry = entry - load(R, (j * p + k) * p + i) * load(y, j * p + k)
            store(y, j * p + i, entry * load(R, (j * p + i) * p + i))
        add_products(q, origin, t, origin, y, j * p, on, minus, Y, j * p * n, n, p, n)
    for a in range(n):
        store(step.stages, a, zero)
    for j in range(N):
        for up in range(p):
            i = p - 1 - up
            entry = dot(Y, (j * p + i) * n, step.stages, j * v, n, load(y, j * p + i))
            for k in range(i + 1, p):
                u = load(step.stages, j * v + n + k)
                entry = fma(load(R, (j * p + i) * p + k), u, entry)
            store(step.stages, j * v + n + i, zero - entry * load(R, (j * p + i) * p + i))
        for a in range(n):
            # as in `roll_out`; in a function for both, a batch takes a tenth longer
            x = dot(M, a * v, step.stages, j * v, v, zero)
            if j + 1 < N:
                store(step.stages, (j + 1) * v + a, x)
            else:
                store(step.end, a, x)


@part
def slope_left(problem, sizes, cost, pulled):
    """Largest slope of the Lagrangian with a control, and the largest term in it.

    The cost's slope and the limits' are told apart; no limit reaches the last state.
    """
    n, v, M = sizes.n, sizes.v, problem.M
    costate, before = np.empty(n * WIDTH), np.empty(n * WIDTH)
    left = largest = spread(0.0)
    for a in range(n):
        store(costate, a, load(cost.end, a))
    for back in range(sizes.N):
        j = sizes.N - 1 - back
        for b in range(v):
            moved = spread(0.0)
            for a in range(n):
                moved = fma(load(M, a * v + b), load(costate, a), moved)
            own, limited = load(cost.stages, j * v + b), load(pulled.stages, j * v + b)
            whole = own + limited + moved
            if b < n:
                store(before, b, whole)
            else:
                left = most(left, size_of(whole))
                largest = most(most(largest, size_of(own)), most(size_of(limited), size_of(moved)))
        for a in range(n):
            store(costate, a, load(before, a))
    return left, largest


@part
def row_of(problem, sizes, path, j, k):
    """Value of row k of D at stage j."""
    v, value = sizes.v, spread(0.0)
    for first in range(problem.used[k]):
        a = problem.places[k * v + first]
        value = fma(load(problem.D, k * v + a), load(path.stages, j * v + a), value)
    return value


@part
def add_row(problem, sizes, slope, j, k, factor):
    """Add a multiple of row k of D to a slope at stage j."""
    v = sizes.v
    for first in range(problem.used[k]):
        a = problem.places[k * v + first]
        entry = j * v + a
        store(
            slope.stages, entry, fma(factor, load(problem.D, k * v + a), load(slope.stages, entry))
        )


@part
def move(path, step, far, moves, length, n):
    """Go a part of a step where `moves` is 1."""
    half = spread(0.5)
    for k in range(length):
        old = load(path.stages, k)
        store(path.stages, k, where_less(half, moves, fma(far, load(step.stages, k), old), old))
    for k in range(n):
        old = load(path.end, k)
        store(path.end, k, where_less(half, moves, fma(far, load(step.end, k), old), old))
