"""One iteration of the interior point in kernels: predictor, corrector, and the step of both."""

from typing import Any

from jcontour.kernels.arithmetic import is_finite, larger, smaller, where
from jcontour.qp.lanes.kernel import Kernel, Sizes
from jcontour.qp.lanes.limits import aimed, every, net, point, predicted, write_point
from jcontour.qp.lanes.stage import (
    pulled,
    row,
    stages,
    symmetric,
    triangle,
    write,
)
from jcontour.qp.lanes.sweeps import backward, costates, factorise, forward
from jcontour.qp.one_sided import (
    Changes,
    Point,
    changes,
    gap,
    missed_by,
    moved_on,
    newton,
    possible,
    products,
    pushes,
)
from jcontour.qp.path import (
    AIM,
    CLOSE,
    CLOSEST,
    FAR,
    INWARD,
    MISSED,
    NEAR,
    SPOILT,
)

LIMITS = "D lower upper penalty"
NOW = "s l t g value"


def _gap_ahead(now: Point, change: Changes) -> tuple:
    """Factors of far and of far^2 in the products after a part of a step."""
    first = now.s * change.l + now.l * change.s + now.t * change.g + now.g * change.t
    return first, change.s * change.l + change.t * change.g


def _predict(sizes: Sizes, at) -> None:
    """Predictor's step, of which the rows are kept, and what the corrector aims at."""

    def visit(j, step, carried):
        far, first, second = carried
        moves = [row(sizes, at, k, step) for k in range(sizes.r)]
        for limit in every(sizes, at, j):
            value, moved = at.value[j * sizes.r + limit.row], moves[limit.row]
            now, _, change = predicted(at, limit, value, moved)
            far = smaller(far, possible(now, change, limit.limits))
            one, other = _gap_ahead(now, change)
            first, second = first + one, second + other
        write(at.moves, j, moves)
        return [far, first, second]

    _, (far, first, second) = forward(sizes, at, visit, (1.0, 0.0, 0.0))
    mu = at.gap[0] / at.count[0]
    left = (at.gap[0] + far * (first + far * second)) / at.gap[0]
    target = smaller(larger(left, 0.0), 1.0) ** 3 * mu
    at.target[0] = larger(target, AIM * at.largest[0])
    at.share[0] = where(far > FAR, 1.0, far)


predict = Kernel(
    _predict,
    f"A B {LIMITS}",
    f"Y y R {NOW} gap count largest open",
    "moves target share",
    softens=True,
)


def _correct(sizes: Sizes, at) -> None:
    """Sweep back with the corrector's slope."""

    def slope(j):
        pairs = []
        for limit in every(sizes, at, j):
            here = j * sizes.r + limit.row
            found = predicted(at, limit, at.value[here], at.moves[here])
            pushed = aimed(at, limit, found).pushed
            pairs.append((limit, found.point.l + found.here.weight * pushed))
        return pulled(sizes, at, net(sizes, pairs), stages(at.slope, j, sizes.v))

    backward(sizes, at, slope)


correct = Kernel(
    _correct,
    f"A B {LIMITS}",
    f"Y R {NOW} slope slope_end moves target share open",
    "y",
    softens=True,
)


def _step(sizes: Sizes, at) -> None:
    """Corrector's step, the changes of slacks and multipliers, and how far they may go."""

    def visit(j, step, carried):
        far, first, second = carried
        moves = [row(sizes, at, k, step) for k in range(sizes.r)]
        for limit in every(sizes, at, j):
            here = j * sizes.r + limit.row
            found = predicted(at, limit, at.value[here], at.moves[here])
            aims, pushed = aimed(at, limit, found)
            moved = where(limit.limits.there, limit.sign * moves[limit.row], 0.0) + pushed
            change = changes(found.here, found.point, limit.limits, moved, *aims)
            far = smaller(far, possible(found.point, change, limit.limits))
            one, other = _gap_ahead(found.point, change)
            first, second = first + one, second + other
            k = limit.place
            at.ds[k], at.dl[k] = change.s, change.l
            if at.soft:
                at.dt[k], at.dg[k] = change.t, change.g
        write(at.step, j, step)
        return [far, first, second]

    end, (far, first, second) = forward(sizes, at, visit, (1.0, 0.0, 0.0))
    far = where(far < 1, INWARD * far, 1.0)
    write(at.step_end, 0, end)
    at.far[0] = far
    at.ahead[0] = at.gap[0] + far * (first + far * second)


step = Kernel(
    _step,
    f"A B {LIMITS}",
    f"Y y R {NOW} moves target share gap open",
    "step step_end ds dl dt dg far ahead",
    softens=True,
)


def _look(sizes: Sizes, at) -> None:
    """Slope ahead, and whether what it leaves there is good enough to go on."""
    far, r = at.far[0], sizes.r

    def ahead(now, steps, j, count: int) -> list:
        pairs = zip(stages(now, j, count), stages(steps, j, count), strict=True)
        return [value + far * change for value, change in pairs]

    def slopes(j) -> tuple[list, list]:
        entries = len(triangle(sizes.v))
        v, h = ahead(at.stages, at.step, j, sizes.v), stages(at.h, j, sizes.v)
        own = symmetric(lambda k: at.H[j * entries + k], sizes.v, v, h)
        write(at.slope, j, own)
        upper, lower = (ahead(at.l, at.dl, side + j, r) for side in (0, sizes.N))
        net = [one - other for one, other in zip(upper, lower, strict=True)]
        return own, pulled(sizes, at, net, [0.0] * sizes.v)

    end = ahead(at.end, at.step_end, 0, sizes.n)
    end = symmetric(lambda k: at.H_end[k], sizes.n, end, stages(at.h_end, 0, sizes.n))
    write(at.slope_end, 0, end)
    after = costates(sizes, at, end, slopes)
    near = at.gap[0] < NEAR * at.count[0] * at.largest[0]
    spoilt = near & (after > larger(at.before[0], SPOILT))
    # a number of the trajectory that is not finite leaves no slope that is
    good = is_finite(at.ahead[0] + after) & ~spoilt & (at.open[0] > 0)
    at.iterations[0] = at.iterations[0] + at.open[0]
    grown = larger(at.largest[0], at.ahead[0] / at.count[0])
    at.largest[0] = where(good, grown, at.largest[0])
    at.before[0] = after
    at.good[0] = where(good, 1.0, 0.0)


look = Kernel(
    _look,
    "A B H h H_end h_end D",
    "stages end step step_end l dl far ahead gap count open",
    "slope slope_end before largest iterations good",
)


def linearised(sizes: Sizes, at, j, v, points) -> list:
    """Write weights and right side of a stage: products and largest miss, over the width.

    Args:
        sizes: sizes.
        at: the lanes.
        j: the stage.
        v: its states and controls.
        points: limits with their slacks and multipliers.
    """
    values = [row(sizes, at, k, v) for k in range(sizes.r)]
    write(at.value, j, values)
    weight, pairs, total, missed = [0.0] * sizes.r, [], 0.0, 0.0
    for limit, now in points:
        value, limits = limit.sign * values[limit.row], limit.limits
        here = newton(now, limits, value)
        pushed = pushes(here, now, limits, *products(now, limits))
        pairs.append((limit, now.l + here.weight * pushed))
        weight[limit.row] = weight[limit.row] + here.weight
        total = total + gap(now)
        miss = abs(missed_by(now, limits, value)) / limits.width
        missed = larger(missed, miss)
    write(at.weight, j, weight)
    write(at.right, j, pulled(sizes, at, net(sizes, pairs), stages(at.slope, j, sizes.v)))
    return [total, missed]


def goes_on(gap, missed, count, largest):
    """Whether a lane has not come to the end of its path."""
    mu = gap / count
    later = (missed > MISSED) & (mu > CLOSEST * largest)
    return (mu > CLOSE * largest) | later


def _move(sizes: Sizes, at) -> None:
    """Go the step where it is good, and state Newton's equations there."""
    far, good = at.far[0], at.good[0] > 0

    def chosen(column, change, k):
        column[k] = moved = where(good, column[k] + far * change[k], column[k])
        return moved

    def on(j, carried):
        total, missed = carried
        v = [chosen(at.stages, at.step, j * sizes.v + k) for k in range(sizes.v)]
        points = []
        for limit in every(sizes, at, j):
            k, now = limit.place, point(at, limit)
            way: tuple[Any, Any] = (at.dt[k], at.dg[k]) if at.soft else (0.0, 0.0)
            change = Changes(at.ds[k], at.dl[k], *way)
            ahead = moved_on(now, None, change, far)
            pairs = zip(ahead[1:], now[1:], strict=True)
            now = Point(None, *(where(good, one, other) for one, other in pairs))
            write_point(at, limit, now)
            points.append((limit, now))
        more, worst = linearised(sizes, at, j, v, points)
        return [total + more, larger(missed, worst)]

    total, missed = at.loop(sizes.N, on, (0.0, 0.0))
    for k in range(sizes.n):
        chosen(at.end, at.step_end, k)
    at.gap[0] = total
    later = goes_on(total, missed, at.count[0], at.largest[0])
    at.open[0] = where(good & later, 1.0, 0.0)


move = Kernel(
    _move,
    LIMITS,
    "step step_end ds dl dt dg far good slope count largest",
    f"stages end {NOW} weight right gap open",
    beside="D",
    registers=128,  # 20 % faster than with all
    softens=True,
)

ITERATION = factorise, predict, correct, step, look, move
