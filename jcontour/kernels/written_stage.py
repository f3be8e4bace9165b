"""One stage back of the Riccati recursion, written out number by number over a plant's non-zeros.

The equations are those of `window_sweep`, with the inputs eliminated before the model acts. With a
1 behind the state, so that H has g in its last column,

    G = (B' H B + R)^-1,   L = G B' H,   K = L A,   H_j = A' (H - H B L) A + C' Q_j C,   H = H_{j+1}
Kernels of a GPU compute with vectors over their lanes (`gain_lanes`), programs for a CPU with eight
lanes (`kernels.sweeps.stage_sweep`).
"""

from functools import lru_cache
from itertools import combinations_with_replacement, product
from typing import NamedTuple

from jcontour.kernels.arithmetic import dot
from jcontour.kernels.packed_stage import definite_inverse
from jcontour.kernels.packing import seen_entries
from jcontour.linear.plant import Pattern, decoupled_axes


class Sizes(NamedTuple):
    """Static sizes: states, inputs, outputs, steps, preview; is a terminal cost given?"""

    n: int
    p: int
    m: int
    steps: int
    preview: int
    ended: bool

    @property
    def samples(self) -> int:
        """Samples that are seen, S."""
        return self.steps + self.preview

    @property
    def weighed(self) -> int:
        """Stages whose output is weighted with Q."""
        return self.preview - self.ended


class Shape(NamedTuple):
    """Static structure of the numbers.

    Labels: states from 0, the 1 is n, inputs from n + 1.

    Attributes:
        parts: groups of states that nothing couples.
        rows: non-zero rows of every column of M = [A B].
        C: non-zeros of C.
        entries: entries of H with g, each once.
        seen: entries of [Q, -Q y_d], each once.
    """

    parts: tuple[tuple[int, ...], ...]
    rows: dict[int, tuple[int, ...]]
    C: tuple[tuple[int, int], ...]
    entries: tuple[tuple[int, int], ...]
    seen: tuple[tuple[int, int], ...]


@lru_cache
def shape_of(pattern: Pattern) -> Shape:
    """Shape of all plants with one pattern."""
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    parts = tuple(axis.states for axis in decoupled_axes(pattern))
    rows = {k: tuple(i for i in range(n) if pattern.A[i][k]) for k in range(n)}
    rows |= {n + 1 + u: tuple(i for i in range(n) if pattern.B[i][u]) for u in range(p)}
    C = tuple((a, i) for a in range(m) for i in range(n) if pattern.C[a][i])
    entries = (*combinations_with_replacement(range(n), 2), *((i, n) for i in range(n)))
    return Shape(parts, rows, C, entries, tuple((int(a), int(b)) for a, b in seen_entries(m).T))


def key(i: int, k: int) -> tuple[int, int]:
    """Entry that stands for both (i, k) and (k, i)."""
    return (i, k) if i <= k else (k, i)


class Choice(NamedTuple):
    """Best control of one stage: H B, G and L, with the 1 behind the states."""

    HB: list[list]
    G: list[list]
    L: list[list]


def choice(shape: Shape, sizes: Sizes, M, R, H) -> Choice:
    """Control that minimises one stage and the cost H that remains.

    Every number is a vector over lanes.
    """
    inputs = range(sizes.n + 1, sizes.n + 1 + sizes.p)
    HB = [
        [dot((H[key(i, k)], M[k, u]) for k in shape.rows[u]) for u in inputs]
        for i in range(sizes.n + 1)
    ]
    BHB = [
        [dot(((M[i, u], HB[i][v]) for i in shape.rows[u]), R[k][v]) for v in range(sizes.p)]
        for k, u in enumerate(inputs)
    ]
    G = definite_inverse(BHB)
    return Choice(HB, G, [[dot(zip(row, products, strict=True)) for products in HB] for row in G])


def gain(shape: Shape, sizes: Sizes, M, L) -> list[list]:
    """Gain K = L A."""
    return [
        [*(dot((row[i], M[i, k]) for i in shape.rows[k]) for k in range(sizes.n)), row[sizes.n]]
        for row in L
    ]


def remembered(shape: Shape, sizes: Sizes, M, L, X):
    """Product X (A - B K) = X (I - B L) A of a later loop's transitions with that of a stage."""
    states, n = range(sizes.n), sizes.n
    Y = {}
    for i in states:
        XB = [
            dot((X[i, k], M[k, n + 1 + u]) for k in shape.rows[n + 1 + u]) for u in range(sizes.p)
        ]
        for k in states:
            Y[i, k] = dot(
                ((-of_input, row[k]) for of_input, row in zip(XB, L, strict=True)), X[i, k]
            )
    return {(i, k): dot((Y[i, j], M[j, k]) for j in shape.rows[k]) for i in states for k in states}


def cost_in_front(shape: Shape, sizes: Sizes, M, H, chosen: Choice):
    """Cost to go in front of a stage, without its output: A' (H - H B L) A."""
    n, L = sizes.n, chosen.L
    P = {
        (i, k): dot(((-HB, row[k]) for HB, row in zip(chosen.HB[i], L, strict=True)), H[i, k])
        for i, k in shape.entries
    }
    H = {(i, n): dot((M[k, i], P[k, n]) for k in shape.rows[i]) for i in range(n)}
    for left, right in combinations_with_replacement(shape.parts, 2):
        for c, column in enumerate(right):
            heads = left[: c + 1] if left == right else left
            needed = sorted({i for head in heads for i in shape.rows[head]})
            PA = {i: dot((P[key(i, k)], M[k, column]) for k in shape.rows[column]) for i in needed}
            for head in heads:
                H[key(head, column)] = dot((M[i, head], PA[i]) for i in shape.rows[head])
    return H


def weigh(shape: Shape, sizes: Sizes, C, H, cost):
    """Cost H + C' Q C; `cost` holds the numbers of [Q, -Q y_d]."""
    H, Q = dict(H), dict(zip(shape.seen, cost, strict=True))
    for (a, i), (b, k) in product(shape.C, repeat=2):
        if i <= k:
            H[i, k] = dot([(C[a, i] * C[b, k], Q[key(a, b)])], H[i, k])
    for a, i in shape.C:
        H[i, sizes.n] = dot([(C[a, i], Q[a, sizes.m])], H[i, sizes.n])
    return H
