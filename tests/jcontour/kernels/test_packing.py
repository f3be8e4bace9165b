"""The packing of symmetric matrices, against whole ones."""

import numpy as np
import pytest

from jcontour.kernels.packing import congruence, packing, seen_entries
from jcontour.linear.plant import Pattern


def symmetric(size, seed):
    M = np.random.default_rng(seed).standard_normal((size, size))
    return M + M.T


def pattern_of(axes):
    """Axes of two coupled states with one input and one output each."""
    block, column, row = np.ones((2, 2)), np.ones((2, 1)), np.ones((1, 2))
    return Pattern.of(*(np.kron(np.eye(axes), part) for part in (block, column, row)))


def upper(size):
    return np.array(np.triu_indices(size))


@pytest.mark.parametrize("wanted", [5, 3])
def test_congruence_takes_entries_to_entries_of_the_product(wanted):
    M = np.random.default_rng(1).standard_normal((4, wanted))
    X = symmetric(4, 2)
    product = M.T @ X @ M
    found = congruence(M, upper(wanted), upper(4)) @ X[tuple(upper(4))]
    np.testing.assert_allclose(found, product[tuple(upper(wanted))], rtol=1e-12)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_every_entry_is_kept_once(axes):
    pack, n, p = packing(pattern_of(axes)), 2 * axes, axes
    kept = [tuple(sorted(entry)) for block in pack.blocks for entry in block.entries.T.tolist()]
    labels = [*range(n), *range(n + 1, n + 1 + p)]
    wanted = {(i, k) for i in labels for k in labels if i <= k}
    wanted |= {tuple(sorted((i, n))) for i in labels}
    assert len(kept) == len(set(kept)) and set(kept) == wanted
    assert sorted(pack.order) == list(range(n))


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_rows_and_squares_of_the_inputs_are_found(axes):
    pack, n, p = packing(pattern_of(axes)), 2 * axes, axes
    Z = symmetric(n + 1 + p, 3)
    blocks = [Z[tuple(block.entries)] for block in pack.blocks]
    for u, pieces in enumerate(pack.rows):
        row = np.concatenate([blocks[c][first:last] for c, first, last in pieces])
        np.testing.assert_array_equal(row, Z[n + 1 + u, : n + 1])
        for v in range(p):
            block, place = pack.square[u, v]
            assert blocks[block][place] == Z[n + 1 + u, n + 1 + v]


def test_entries_of_the_cost_end_before_the_corner():
    assert seen_entries(2).T.tolist() == [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2]]
