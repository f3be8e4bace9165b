"""Where the path begins, in kernels: the guess, and mu from the minimum without limits."""

from jcontour.kernels.arithmetic import dot, larger, where
from jcontour.qp.lanes.iteration import LIMITS, goes_on, linearised
from jcontour.qp.lanes.kernel import Kernel, Sizes
from jcontour.qp.lanes.limits import every, write_point
from jcontour.qp.lanes.stage import (
    after,
    row,
    stages,
    symmetric,
    triangle,
    write,
)
from jcontour.qp.lanes.sweeps import factorise, forward
from jcontour.qp.one_sided import Point, first_point
from jcontour.qp.path import FIRST, ROOM


def _roll(sizes: Sizes, at) -> None:
    """States that the guess leads to, and the cost's slope there."""
    n, v, entries = sizes.n, sizes.v, len(triangle(sizes.v))

    def on(j, x):
        here = x + stages(at.guess, j, sizes.p)
        write(at.stages, j, here)
        slope = symmetric(lambda k: at.H[j * entries + k], v, here, stages(at.h, j, v))
        write(at.slope, j, slope)
        write(at.right, j, slope)
        write(at.weight, j, [0.0] * sizes.r)
        return after(sizes, at, here, stages(at.c, j, n))

    end = at.loop(sizes.N, on, stages(at.x0, 0, n))
    write(at.end, 0, end)
    slope = symmetric(lambda k: at.H_end[k], n, end, stages(at.h_end, 0, n))
    write(at.slope_end, 0, slope)


roll = Kernel(
    _roll,
    "A B c x0 H h H_end h_end guess",
    "",
    "stages end slope slope_end right weight",
)


def _begin(sizes: Sizes, at) -> None:
    """First point: the minimum without limits where it is within them."""
    n, v = sizes.n, sizes.v

    def visit(j, step, carried):
        gain, count, least = carried
        write(at.step, j, step)
        gain = dot(zip(stages(at.slope, j, v), step, strict=True), gain)
        ahead = [a + b for a, b in zip(stages(at.stages, j, v), step, strict=True)]
        values = [row(sizes, at, k, ahead) for k in range(sizes.r)]
        for limit in every(sizes, at, j):
            there = limit.limits.there
            room = limit.limits.bound - limit.sign * values[limit.row]
            count = count + where(there, 1.0, 0.0)
            least = where(there & ~(room > 0), 0.0, least)
        return [gain, count, least]

    end, (gain, count, within) = forward(sizes, at, visit, (0.0, 0.0, 1.0))
    gain = dot(zip(stages(at.slope_end, 0, n), end, strict=True), gain)
    count, within = larger(count, 1.0), within > 0
    mu = larger(FIRST * (-0.5 * gain) / count, at.tiny)

    def on(j, carried):
        total, missed = carried
        v = stages(at.stages, j, sizes.v)
        ahead = [a + b for a, b in zip(v, stages(at.step, j, sizes.v), strict=True)]
        values = [row(sizes, at, k, v) for k in range(sizes.r)]
        free = [row(sizes, at, k, ahead) for k in range(sizes.r)]
        points = []
        for limit in every(sizes, at, j):
            limits, sign = limit.limits, limit.sign
            slack = limits.bound - sign * values[limit.row]
            room = limits.bound - sign * free[limit.row]
            first = first_point(None, slack, mu, limits, ROOM)
            answer = where(limits.there, room, 1.0), 0.0, 0.0, limits.price
            pairs = zip(answer, first[1:], strict=True)
            now = Point(None, *(where(within, one, other) for one, other in pairs))
            write_point(at, limit, now)
            points.append((limit, now))
        v = [where(within, one, other) for one, other in zip(ahead, v, strict=True)]
        write(at.stages, j, v)
        more, worst = linearised(sizes, at, j, v, points)
        return [total + more, larger(missed, worst)]

    total, missed = at.loop(sizes.N, on, (0.0, 0.0))
    for k in range(n):
        at.end[k] = at.end[k] + where(within, end[k], 0.0)
    at.gap[0], at.count[0], at.largest[0] = total, count, mu
    at.before[0] = float("inf")
    at.iterations[0] = 0.0
    at.open[0] = where(goes_on(total, missed, count, mu), 1.0, 0.0)


begin = Kernel(
    _begin,
    f"A B {LIMITS}",
    "Y y R slope slope_end",
    "stages end step s l t g value weight right far gap count largest before iterations open",
)

START = roll, factorise, begin
