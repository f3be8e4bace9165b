"""Iterations of `jcontour.qp.interior_point` on the CPU, eight problems at a time.

The equations, the order and the tests of the readable solver, with all loops over stages in one
call. XLA would call each small operation in them by itself.
"""

import pathlib

import jax
import jax.numpy as jnp
import numpy as np
from numpy import intp  # a literal would be a type of its own, compiled once more

from jcontour import native
from jcontour.native.calls import (
    argument,
    asks,
    drop_stale,
    extent,
    native_call,
    result,
    spoil,
)
from jcontour.native.lanes import (
    WIDTH,
    fma,
    gathered,
    least,
    load,
    most,
    part,
    scatter,
    spread,
    store,
    where_less,
)
from jcontour.native.threads import (
    done,
    frame_of,
    is_work,
    leave,
    next_part,
    own_address,
    shared_work,
)
from jcontour.qp.native.one_sided import (
    Limits,
    Linear,
    Slacks,
    both_sides,
    changes,
    correct,
    counted,
    gap_ahead,
    go,
    linearise,
    progress,
    push,
)
from jcontour.qp.native.staged import (
    Factors,
    Path,
    Problem,
    Sizes,
    factorise,
    move,
    non_zeros,
    roll_out,
    row_of,
    slope_at,
    slope_left,
    step_of,
)
from jcontour.qp.one_sided import Point
from jcontour.qp.path import (
    AIM,
    CLOSE,
    CLOSEST,
    FAR,
    FIRST,
    INWARD,
    MISSED,
    MOST,
    NEAR,
    ROOM,
    SPOILT,
)
from jcontour.qp.staged import Trajectory

RESULTS = 7
_HERE = pathlib.Path(__file__).parent
TINY = float(np.finfo(float).tiny ** 0.5)
for _folder in (pathlib.Path(native.__path__[0]), _HERE.parent):
    drop_stale(_HERE, *_HERE.glob("*.py"), *_folder.glob("*.py"))


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
        s = where_less(half, there, most(slack, spread(ROOM) * load(limits.width, k)), one)
        price, l = load(limits.price, k), where_less(half, there, mu / s, zero)  # noqa: E741
        l = where_less(half, gives, least(l, half * price), l)  # noqa: E741
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
def _any(flags):
    found = False
    for lane in range(WIDTH):
        found = found or flags[lane] > 0.5
    return found


@part
def _copy(slope, right, length, n):
    for k in range(length):
        store(right.stages, k, load(slope.stages, k))
    for k in range(n):
        store(right.end, k, load(slope.end, k))


@part
def _left(problem, sizes, now, change, far, slope, pulled):
    """Slope with a control that is left after a step, over its largest term; fills `pulled`."""
    for k in range(sizes.N * sizes.v):
        store(pulled.stages, k, spread(0.0))
    for k in range(2 * sizes.N * sizes.r):
        push(problem, sizes, pulled, k, fma(far, load(change.l, k), load(now.l, k)))
    left, largest = slope_left(problem, sizes, slope, pulled)
    return left / most(largest, spread(TINY))


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
    step, slope, right, ahead = _path(sizes), _path(sizes), _path(sizes), _path(sizes)
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
    left_before = spread(np.inf)
    largest = _begin(problem, sizes, limits, path, step, slope, factors, now)
    slope_at(problem, sizes, path, slope)
    for _ in range(MOST):
        mu, missed = progress(problem, sizes, limits, path, now, linear)
        later = where_less(spread(MISSED), missed, one, zero)
        later = where_less(spread(CLOSEST) * largest, mu, later, zero)
        open_ = where_less(spread(CLOSE) * largest, mu, one, later) * goes_on
        store(unfinished, 0, open_)
        if not _any(unfinished):
            break
        store(iterations, 0, load(iterations, 0) + open_)
        _copy(slope, right, N * v, n)
        linearise(problem, sizes, limits, now, linear, right)
        both_sides(linear, both, N * sizes.r)
        factorise(problem, sizes, both, factors)
        step_of(problem, sizes, factors, right, step)
        far = changes(problem, sizes, limits, now, linear, step, change)
        left = gap_ahead(limits, now, change, far, size) / (number * mu)
        left = least(most(left, zero), one)
        share = where_less(spread(FAR), far, one, far)
        _copy(slope, right, N * v, n)
        target = most(left * left * left * mu, spread(AIM) * largest)
        correct(problem, sizes, limits, now, linear, change, target, share, right)
        step_of(problem, sizes, factors, right, step)
        far = changes(problem, sizes, limits, now, linear, step, change)
        far = where_less(far, one, spread(INWARD) * far, one)
        gap = gap_ahead(limits, now, change, far, size)
        total = gap
        _copy(path, ahead, N * v, n)
        move(ahead, step, far, one, N * v, n)
        for k in range(N * v):
            total = total + load(ahead.stages, k)
        slope_at(problem, sizes, ahead, slope)
        left_after = _left(problem, sizes, now, change, far, slope, right)
        spoilt = where_less(most(left_before, spread(SPOILT)), left_after, one, zero)
        spoilt = where_less(mu, spread(NEAR) * largest, spoilt, zero)
        left_before = left_after
        # inf and NaN less themselves are NaN, which is less than nothing
        goes_on = goes_on * where_less(total - total, one, one, zero) * (one - spoilt)
        moves = open_ * goes_on
        largest = where_less(half, moves, most(largest, gap / number), largest)
        move(path, step, far, moves, N * v, n)
        go(limits, now, change, far, moves, size)


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
    number, some_give = counted(there, gives, size)
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


@part
def _sizes(frame):
    n, v = extent(frame, intp(0), intp(2)), extent(frame, intp(0), intp(1))
    return Sizes(extent(frame, intp(4), intp(2)), n, v - n, v, extent(frame, intp(7), intp(2)))


@native_call("jcontour_interior_point")
def _call(address):
    first = not is_work(address)
    if first:
        if asks(address):
            return 0
        for k in range(RESULTS):
            spoil(result(address, k))
        count = len(argument(address, intp(2))) // _sizes(address).n
        work = shared_work(address, -(-count // WIDTH), own_address())
    else:
        work = address
    if work == 0:
        return 0
    at = next_part(work)
    while at >= 0:
        frame = frame_of(work)
        sizes = _sizes(frame)
        try:
            _eight(frame, sizes, WIDTH * at, len(argument(frame, intp(2))) // sizes.n)
        except Exception:  # no memory: the results stay NaN
            pass
        done(work)
        at = next_part(work)
    leave(work, first)
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
