"""Riccati sweep and its steps, as in `jcontour.qp.staged`: one lane per problem."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from jcontour.kernels.arithmetic import dot, larger
from jcontour.qp.lanes.kernel import Kernel, Sizes
from jcontour.qp.lanes.stage import (
    after,
    before,
    model,
    place,
    stages,
    triangle,
    write,
)
from jcontour.qp.staged import cholesky, eliminated, returned

COLUMNS = 2  # of A' P A at once: more keep more numbers in registers, fewer read A more often


def _factorise(sizes: Sizes, at) -> None:
    n = sizes.n

    def back(j, behind):
        P, q = behind[:-n], behind[-n:]
        q = _law(sizes, at, j, P, q)
        return _cost_in_front(sizes, at, j, P) + q

    P = [at.H_end[k] for k in range(len(triangle(n)))]
    at.backwards(sizes.N, back, P + stages(at.slope_end, 0, n))


def _law(sizes: Sizes, at, j, P: Sequence, q: Sequence) -> list:
    """Write the control law of a stage: q of the stage in front.

    Y is read again where it is needed: registers are few.
    """
    n, p, inputs = sizes.n, sizes.p, range(sizes.p)
    PB, heavy, G, t = [], [], [], []
    for u in inputs:
        column = ModelColumn.of(sizes, at, n + u)
        PB.append(column.times(P))
        heavy.append(column.weighed(at, j))
        G.append([column.entry(sizes, at, j, w + n, PB[w], heavy[w]) for w in range(u + 1)])
        t.append(dot(zip(column.model, q, strict=True), at.right[j * sizes.v + n + u]))
    R = cholesky([[G[max(u, w)][min(u, w)] for w in inputs] for u in inputs])
    y = eliminated(R, t)
    write(at.R, j, [R[u][w] for u in inputs for w in range(u, p)])
    write(at.y, j, y)
    front = []
    for a in range(n):
        column = ModelColumn.of(sizes, at, a)
        Y = eliminated(R, [column.entry(sizes, at, j, n + u, PB[u], heavy[u]) for u in inputs])
        for u in inputs:
            at.Y[(j * p + u) * n + a] = Y[u]
        t = dot(zip(column.model, q, strict=True), at.right[j * sizes.v + a])
        front.append(t - dot(zip(Y, y, strict=True)))
    return front


def _cost_in_front(sizes: Sizes, at, j, P: Sequence) -> list:
    """P of the stage in front, by its lower triangle."""
    n, p = sizes.n, sizes.p
    found = {}
    for first in range(0, n, COLUMNS):
        PA, heavy, pulled = {}, {}, {}
        for a in range(first, n):
            column, Y = ModelColumn.of(sizes, at, a), [at.Y[(j * p + u) * n + a] for u in range(p)]
            if a < first + COLUMNS:
                PA[a], heavy[a], pulled[a] = column.times(P), column.weighed(at, j), Y
            for b in PA:
                if b <= a:
                    ahead = column.entry(sizes, at, j, b, PA[b], heavy[b])
                    found[a, b] = ahead - dot(zip(Y, pulled[b], strict=True))
    return [found[entry] for entry in triangle(n)]


class ModelColumn(NamedTuple):
    """Column k of M = [A B] and of D."""

    k: int
    model: list
    limited: list

    @classmethod
    def of(cls, sizes: Sizes, at, k: int) -> "ModelColumn":
        """Column, read once."""
        limited = [at.D[row * sizes.v + k] for row in range(sizes.r)]
        return cls(k, [model(sizes, at, i, k) for i in range(sizes.n)], limited)

    def times(self, P: Sequence) -> list:
        """P M, P by its lower triangle."""
        rows = range(len(self.model))
        return [dot((P[place(i, m)], self.model[m]) for m in rows) for i in rows]

    def weighed(self, at, j) -> list:
        """W D at a stage."""
        rows = len(self.limited)
        return [at.weight[j * rows + k] * d for k, d in enumerate(self.limited)]

    def entry(self, sizes: Sizes, at, j, b: int, PM: Sequence, heavy: Sequence):
        """Entry (k, b) of H + D' W D + M' P M, from columns b of P M and W D."""
        H = at.H[j * len(triangle(sizes.v)) + place(self.k, b)]
        limited = dot(zip(self.limited, heavy, strict=True), H)
        return dot(zip(self.model, PM, strict=True), limited)


factorise = Kernel(
    _factorise, "A B H H_end D", "weight right slope_end open", "Y y R", beside="A B D"
)


def backward(sizes: Sizes, at, slope: Callable) -> None:
    """Another y for another slope, `slope(j)`, from the factors of the same H."""
    n, p = sizes.n, sizes.p

    def back(j, q):
        t = slope(j)
        t = [before(sizes, at, q, k, t[k]) for k in range(sizes.v)]
        y = eliminated(_factor(sizes, at, j), t[n:])
        write(at.y, j, y)
        return [t[a] - dot((at.Y[(j * p + u) * n + a], y[u]) for u in range(p)) for a in range(n)]

    at.backwards(sizes.N, back, stages(at.slope_end, 0, n))


def forward(sizes: Sizes, at, visit: Callable, begun: Sequence) -> tuple[list, list]:
    """The step along the model, and what `visit(j, step, carried)` carries through the stages.

    Returns:
        The step of the last state, and what was carried.
    """
    n, p = sizes.n, sizes.p

    def on(j, carried):
        x, carried = carried[:n], carried[n:]
        y = stages(at.y, j, p)
        z = [dot(((at.Y[(j * p + u) * n + a], x[a]) for a in range(n)), y[u]) for u in range(p)]
        step = x + [-number for number in returned(_factor(sizes, at, j), z)]
        return after(sizes, at, step, [0.0] * n) + visit(j, step, carried)

    found = at.loop(sizes.N, on, [0.0] * n + list(begun))
    return found[:n], found[n:]


def costates(sizes: Sizes, at, end: Sequence, slopes: Callable) -> Any:
    """Largest slope of the Lagrangian with a control that is left, over its largest term.

    The scale is `jcontour.qp.path.rounding` of the slope h, and of what its costates add, at least.

    Args:
        sizes: sizes.
        at: the lanes.
        end: the cost's slope with the last state.
        slopes: j -> the cost's slope with the numbers of a stage, and the limits'.
    """
    n, v = sizes.n, sizes.v

    def back(j, carried):
        costate, apart, (left, largest, whole) = carried[:n], carried[n : 2 * n], carried[2 * n :]
        own, limited = slopes(j)
        h = stages(at.h, j, v)
        moved = [before(sizes, at, costate, k) for k in range(v)]
        moved_apart = [before(sizes, at, apart, k) for k in range(v)]
        total = [sum(terms) for terms in zip(own, limited, moved, strict=True)]
        for k in range(n, v):
            left = larger(left, abs(total[k]))
            for term in (own[k], limited[k], moved[k]):
                largest = larger(largest, abs(term))
            for term in (h[k], moved_apart[k]):
                whole = larger(whole, abs(term))
        linear = [one + other for one, other in zip(h, moved_apart, strict=True)]
        return [*total[:n], *linear[:n], left, largest, whole]

    begun = [*end, *stages(at.h_end, 0, n), 0.0, 0.0, 0.0]
    left, largest, whole = at.backwards(sizes.N, back, begun)[2 * n :]
    return left / larger(larger(largest, at.rounding * whole), at.tiny)


def _factor(sizes: Sizes, at, j) -> list[list]:
    """R of a stage by its rows."""
    p = sizes.p
    numbers = iter(stages(at.R, j, len(triangle(p))))
    return [[next(numbers) if w >= u else 0.0 for w in range(p)] for u in range(p)]
