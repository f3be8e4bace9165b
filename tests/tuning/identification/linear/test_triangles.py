"""R of a long matrix: that of one factorisation, but for the signs of its rows."""

import numpy as np
import pytest

from tuning.identification.linear.triangles import BLOCK, triangle_of


@pytest.mark.parametrize("rows", [3, BLOCK - 1, 2 * BLOCK, 5 * BLOCK + 17, 500 * BLOCK + 1])
def test_the_triangle_is_that_of_one_piece(rows):
    random = np.random.default_rng(rows)
    columns = random.standard_normal((rows, 5)) * np.array([1e-6, 1.0, 1e3, 1.0, 1e-3])
    found, wanted = triangle_of(columns), np.linalg.qr(columns, mode="r")
    assert found.shape == wanted.shape
    scale = np.abs(wanted).max(axis=0)
    signs = np.sign(np.diag(found)) * np.sign(np.diag(wanted))
    np.testing.assert_allclose(found / scale, signs[:, None] * wanted / scale, atol=1e-12)
    assert not np.tril(found, -1).any()


def test_nearly_equal_columns_keep_their_difference():
    """The squares of a Gram matrix would lose it: 1e-10 beside 1."""
    random = np.random.default_rng(0)
    one, other = random.standard_normal((2, 10 * BLOCK))
    other -= one * (one @ other) / (one @ one)
    found = triangle_of(np.stack([one, one + 1e-10 * other], axis=1))
    assert abs(found[1, 1]) == pytest.approx(1e-10 * np.linalg.norm(other), rel=1e-5)


def test_no_columns_have_a_triangle_without_any():
    assert triangle_of(np.zeros((1000, 0))).shape == (0, 0)
