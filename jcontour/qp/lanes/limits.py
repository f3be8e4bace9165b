"""Limits of a stage in a lane: `jcontour.qp.one_sided` for every row and both sides."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from jcontour.kernels.arithmetic import where
from jcontour.qp.lanes.kernel import Sizes
from jcontour.qp.one_sided import (
    Changes,
    Limits,
    Newton,
    Point,
    changes,
    newton,
    products,
    pushes,
    sides,
)
from jcontour.qp.one_sided import corrected as with_products


class OneSided(NamedTuple):
    """A limit at a stage.

    Attributes:
        row: its row.
        place: of its numbers among those of all limits.
        sign: 1 from above, -1 from below.
        limits: its bound, and what else is known of it.
    """

    row: int
    place: Any
    sign: float
    limits: Limits


def every(sizes: Sizes, at, j) -> Iterator[OneSided]:
    """Limits of a stage one by one, those from above and from below of every row."""
    for k in range(sizes.r):
        here = j * sizes.r + k
        both = sides(at.upper[here], at.lower[here], at.penalty[k])
        if not at.soft:
            both = [limits._replace(gives=False, price=1.0) for limits in both]
        for side, sign in enumerate((1.0, -1.0)):
            yield OneSided(k, side * sizes.N * sizes.r + here, sign, both[side])


def point(at, limit: OneSided) -> Point:
    """Slacks and multipliers of a limit."""
    k = limit.place
    way: tuple[Any, Any] = (at.t[k], at.g[k]) if at.soft else (0.0, 1.0)
    return Point(None, at.s[k], at.l[k], *way)


def write_point(at, limit: OneSided, numbers: Point | Changes) -> None:
    """Write slacks and multipliers of a limit."""
    k = limit.place
    at.s[k], at.l[k] = numbers.s, numbers.l
    if at.soft:
        at.t[k], at.g[k] = numbers.t, numbers.g


class Predicted(NamedTuple):
    """Newton's equations of a limit, and what the predictor changes."""

    point: Point
    here: Newton
    changes: Changes


def predicted(at, limit: OneSided, value, moved) -> Predicted:
    """Predictor of a limit whose row has a value, and changes by `moved` with the step."""
    now, limits = point(at, limit), limit.limits
    here, aims = newton(now, limits, limit.sign * value), products(now, limits)
    pushed = pushes(here, now, limits, *aims)
    change = where(limits.there, limit.sign * moved, 0.0) + pushed
    return Predicted(now, here, changes(here, now, limits, change, *aims))


class Aimed(NamedTuple):
    """What a corrector aims at: products of a limit, and what pushes its multiplier."""

    aims: tuple
    pushed: Any


def aimed(at, limit: OneSided, found: Predicted) -> Aimed:
    """Aims of the corrector behind a predictor."""
    now, here, change = found
    aims = with_products(now, limit.limits, change, at.share[0], at.target[0])
    return Aimed(aims, pushes(here, now, limit.limits, *aims))


def net(sizes: Sizes, pairs: Sequence[tuple[OneSided, Any]]) -> list:
    """Sum of both sides' multipliers by row, those from below with a minus."""
    found: list = [0.0] * sizes.r
    for limit, multiplier in pairs:
        found[limit.row] = found[limit.row] + limit.sign * multiplier
    return found
