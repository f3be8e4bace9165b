"""Residuals of an answer, found anew from its controls and multipliers: one lane per problem."""

from jcontour.kernels.arithmetic import larger, where
from jcontour.qp.lanes.kernel import Kernel, Sizes
from jcontour.qp.lanes.limits import every
from jcontour.qp.lanes.stage import (
    after,
    pulled,
    row,
    stages,
    symmetric,
    triangle,
    write,
)
from jcontour.qp.lanes.sweeps import costates


def _check(sizes: Sizes, at) -> None:
    """Roll the controls out; the three residuals of `jcontour.qp.interior_point.Answer`."""
    n, v, entries = sizes.n, sizes.v, len(triangle(sizes.v))

    def on(j, carried):
        x, (hard, gives, costs, pushed, gap) = carried[:n], carried[n:]
        here = x + stages(at.stages, j, v)[n:]
        write(at.stages, j, here)
        slope = symmetric(lambda k: at.H[j * entries + k], v, here, stages(at.h, j, v))
        write(at.slope, j, slope)
        costs = costs + sum(abs(a * b) for a, b in zip(slope, here, strict=True))
        values = [row(sizes, at, k, here) for k in range(sizes.r)]
        for limit in every(sizes, at, j):
            limits, l = limit.limits, at.l[limit.place]  # noqa: E741
            over = limit.sign * values[limit.row] - limits.bound
            over = where(limits.there, over, 0.0)
            beyond, left = larger(over, 0.0), larger(-over, 0.0)
            hard = larger(hard, where(limits.gives, 0.0, beyond / limits.width))
            way = where(limits.gives, beyond, 0.0)
            gives = larger(gives, way)
            pushed = pushed + l * abs(limits.bound)
            gap = gap + l * left + (limits.price - l) * way
        ahead = after(sizes, at, here, stages(at.c, j, n))
        return [*ahead, hard, gives, costs, pushed, gap]

    found = at.loop(sizes.N, on, [*stages(at.x0, 0, n), *([0.0] * 5)])
    end, (hard, gives, costs, pushed, gap) = found[:n], found[n:]
    write(at.end, 0, end)
    slope = symmetric(lambda k: at.H_end[k], n, end, stages(at.h_end, 0, n))
    costs = costs + sum(abs(a * b) for a, b in zip(slope, end, strict=True))
    costs = larger(costs, larger(pushed, at.tiny))

    def slopes(j) -> tuple[list, list]:
        upper, lower = (stages(at.l, side + j, sizes.r) for side in (0, sizes.N))
        net = [one - other for one, other in zip(upper, lower, strict=True)]
        return stages(at.slope, j, v), pulled(sizes, at, net, [0.0] * v)

    dual = costates(sizes, at, slope, slopes)
    at.residual[0] = larger(hard, larger(dual, gap / costs))
    at.beyond[0] = gives


check = Kernel(
    _check,
    "A B c x0 H h H_end h_end D lower upper penalty",
    "l",
    "stages end slope residual beyond",
)
