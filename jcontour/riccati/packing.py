"""Packing of the symmetric matrices of `window_sweep`: the entries that can be non-zero, each once.

With the 1 behind the state, H is n + 1 square, and Hz = [A B]' H [A B] has rows for the inputs as
well. Entries that belong to the same two axes form a block, in which H becomes Hz by one matrix.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement, pairwise, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Int, Shaped

from jcontour.linear.plant import Axis, Pattern, decoupled_axes

# row and column of entries of a symmetric matrix, each entry once
Entries = Int[np.ndarray, "2 _"]


class Part(NamedTuple):
    """Labels of the states and of the inputs of one axis."""

    states: range
    inputs: Sequence[int]


class Block(NamedTuple):
    """Entries of Hz that belong to two axes, those of H first, and the entries of Q that matter."""

    entries: Entries
    of_H: Entries
    weighed: Int[np.ndarray, " q"]


class Packing(NamedTuple):
    """Entries of Hz that are kept, and their places.

    States count from 0 in this order, the 1 is n, inputs count from n + 1.

    Attributes:
        order: the states, axis by axis.
        blocks: one for every two axes, then one for the column of g.
        rows: for every input, the pieces (block, first, last) of its row of Hz_ux.
        square: for every two inputs, the place (block, row) of their entry of Hz_uu.
    """

    order: Int[np.ndarray, " n"]
    blocks: tuple[Block, ...]
    rows: tuple[tuple[tuple[int, int, int], ...], ...]
    square: dict[tuple[int, int], tuple[int, int]]


def seen_entries(outputs: int) -> Entries:
    """Entries of Q with the column -Q y_d, in the order of `window_sweep.SweepData.cost`."""
    return np.array(list(combinations_with_replacement(range(outputs + 1), 2))[:-1]).T


@lru_cache
def packing(pattern: Pattern) -> Packing:
    """Packing of all plants with one pattern."""
    axes = [axis for axis in decoupled_axes(pattern) if axis.states or axis.inputs]
    order = np.array([state for axis in axes for state in axis.states])
    n, p, m = len(order), len(pattern.B[0]), len(pattern.C)
    parts, inputs = _parts(axes, n), range(n + 1, n + 1 + p)
    everything, one = Part(range(n), inputs), Part(range(n, n + 1), ())
    C = np.zeros((m + 1, n + 1), int)
    C[:m, :n], C[m, n] = np.array(pattern.C)[:, order], 1
    blocks, place = [], {}
    for pair in [*combinations_with_replacement(parts, 2), (everything, one)]:
        of_H, of_inputs = _entries(*pair)
        entries = of_H + of_inputs
        place |= {entry: (len(blocks), row) for row, entry in enumerate(entries)}
        entries, of_H = (np.array(some, int).reshape(-1, 2).T for some in (entries, of_H))
        weighed = np.flatnonzero(congruence(C, of_H, seen_entries(m)).any(0))
        blocks.append(Block(entries, of_H, weighed))
    place |= {(v, u): there for (u, v), there in place.items() if u > n}
    rows = tuple(_row(place, u, [*parts, one]) for u in inputs)
    square = {(u - n - 1, v - n - 1): place[u, v] for u, v in product(inputs, repeat=2)}
    return Packing(order, tuple(blocks), rows, square)


def _parts(axes: Sequence[Axis], n: int) -> list[Part]:
    """Labels of every axis, in order."""
    ends = np.cumsum([0] + [len(axis.states) for axis in axes]).tolist()
    inputs = [tuple(n + 1 + u for u in axis.inputs) for axis in axes]
    return [Part(range(*span), own) for span, own in zip(pairwise(ends), inputs, strict=True)]


def _entries(first: Part, second: Part) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Entries of H that belong to two axes, and the entries of Hz with an input."""
    (x, u), (y, v) = first, second
    mixed = [(i, w) for w in v for i in x]
    if first is second:
        of_H = list(combinations_with_replacement(x, 2))
        return of_H, [*mixed, *combinations_with_replacement(u, 2)]
    mixed += [(i, w) for w in u for i in y]
    return list(product(x, y)), [*mixed, *product(u, v)]


def _row(place: dict, u: int, parts: Sequence[Part]) -> tuple[tuple[int, int, int], ...]:
    """Pieces (block, first, last) of the row of Hz_ux of one input."""
    pieces = []
    for part in parts:
        if part.states:
            block, first = place[part.states[0], u]
            pieces.append((block, first, place[part.states[-1], u][1] + 1))
    return tuple(pieces)


def congruence(
    M: Shaped[Array | np.ndarray, "rows columns"],
    of_product: Int[np.ndarray, "2 s"],
    of_X: Int[np.ndarray, "2 r"],
) -> Shaped[Array | np.ndarray, "s r"]:
    """Matrix that takes entries of a symmetric X to entries of M' X M."""
    (i, j), (a, b) = of_product[:, :, None], of_X
    return M[a, i] * M[b, j] + (a != b).astype(M.dtype)[None] * M[b, i] * M[a, j]
