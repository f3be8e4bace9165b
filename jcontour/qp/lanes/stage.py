"""Matrices of a stage, number by number, as the lanes read them."""

from collections.abc import Callable, Sequence
from typing import Any

from jcontour.kernels.arithmetic import dot
from jcontour.qp.lanes.kernel import Sizes


def triangle(size: int) -> list[tuple[int, int]]:
    """Places of the lower triangle of a matrix, row by row."""
    return [(i, k) for i in range(size) for k in range(i + 1)]


def place(i: int, k: int) -> int:
    """Number of an entry of a symmetric matrix in its lower triangle."""
    i, k = max(i, k), min(i, k)
    return i * (i + 1) // 2 + k


def model(sizes: Sizes, at, i: int, k: int):
    """Entry of M = [A B]."""
    n, p, _ = sizes.n, sizes.p, sizes.r
    return at.A[i * n + k] if k < n else at.B[i * p + k - n]


def after(sizes: Sizes, at, v: Sequence, onto: Sequence) -> list:
    """State M v + c of the next stage, c is `onto`."""
    return [
        dot(((model(sizes, at, i, k), v[k]) for k in range(sizes.v)), onto[i])
        for i in range(sizes.n)
    ]


def before(sizes: Sizes, at, costate: Sequence, k: int, onto: Any = 0.0):
    """Entry k of M' costate."""
    return dot(((model(sizes, at, i, k), costate[i]) for i in range(sizes.n)), onto)


def symmetric(entry: Callable[[int], Any], size: int, v: Sequence, onto: Sequence) -> list:
    """Product H v and `onto`; `entry` gives the numbers of the lower triangle of H, each once."""
    found = list(onto)
    for i, k in triangle(size):
        number = entry(place(i, k))
        found[i] = dot([(number, v[k])], found[i])
        if i != k:
            found[k] = dot([(number, v[i])], found[k])
    return found


def row(sizes: Sizes, at, k: int, v: Sequence):
    """Value of row k of D."""
    return dot((at.D[k * sizes.v + a], v[a]) for a in range(sizes.v))


def pulled(sizes: Sizes, at, multipliers: Sequence, onto: Sequence) -> list:
    """Slope D' l and `onto`."""
    return [
        dot(((at.D[k * sizes.v + a], multipliers[k]) for k in range(sizes.r)), onto[a])
        for a in range(sizes.v)
    ]


def stages(column, j, count: int) -> list:
    """Numbers of stage j."""
    return [column[j * count + k] for k in range(count)]


def write(column, j, numbers: Sequence) -> None:
    """Write the numbers of stage j."""
    for k, number in enumerate(numbers):
        column[j * len(numbers) + k] = number
