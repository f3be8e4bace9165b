"""Residuals of an answer, found anew from its controls and multipliers: one lane per problem."""

import jax.numpy as jnp

from jcontour.qp.lanes.lane import Kernel, Sizes
from jcontour.qp.lanes.limits import every
from jcontour.qp.lanes.stage import (
    after,
    loop,
    nothing,
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
    tiny = float(jnp.finfo(at.residual.ref.dtype).tiny ** 0.5)

    def on(j, carried):
        x, (hard, gives, costs, pushed, gap) = carried[:n], carried[n:]
        here = x + stages(at.stages, j, v)[n:]
        write(at.stages, j, here)
        slope = symmetric(lambda k: at.H[j * entries + k], v, here, stages(at.h, j, v))
        write(at.slope, j, slope)
        costs = costs + sum(jnp.abs(a * b) for a, b in zip(slope, here, strict=True))
        values = [row(sizes, at, k, here) for k in range(sizes.r)]
        for limit in every(sizes, at, j):
            limits, l = limit.limits, at.l[limit.place]  # noqa: E741
            over = limit.sign * values[limit.row] - limits.bound
            over = jnp.where(limits.there, over, 0.0)
            beyond, left = jnp.maximum(over, 0.0), jnp.maximum(-over, 0.0)
            hard = jnp.maximum(hard, jnp.where(limits.gives, 0.0, beyond / limits.width))
            way = jnp.where(limits.gives, beyond, 0.0)
            gives = jnp.maximum(gives, way)
            pushed = pushed + l * jnp.abs(limits.bound)
            gap = gap + l * left + (limits.price - l) * way
        ahead = after(sizes, at, here, stages(at.c, j, n))
        return [*ahead, hard, gives, costs, pushed, gap]

    found = loop(sizes.N, on, [*stages(at.x0, 0, n), *([0.0] * 5)], nothing(at.residual))
    end, (hard, gives, costs, pushed, gap) = found[:n], found[n:]
    write(at.end, 0, end)
    slope = symmetric(lambda k: at.H_end[k], n, end, stages(at.h_end, 0, n))
    costs = costs + sum(jnp.abs(a * b) for a, b in zip(slope, end, strict=True))
    costs = jnp.maximum(costs, jnp.maximum(pushed, tiny))

    def slopes(j) -> tuple[list, list]:
        upper, lower = (stages(at.l, side + j, sizes.r) for side in (0, sizes.N))
        net = [one - other for one, other in zip(upper, lower, strict=True)]
        return stages(at.slope, j, v), pulled(sizes, at, net, [0.0] * v)

    dual = costates(sizes, at, slope, slopes, nothing(at.residual))
    at.residual[0] = jnp.maximum(hard, jnp.maximum(dual, gap / costs))
    at.beyond[0] = gives


check = Kernel(
    _check,
    "A B c x0 H h H_end h_end D lower upper penalty",
    "l",
    "stages end slope residual beyond",
)
