"""Eight numbers as one value, against NumPy."""

import numba
import numpy as np

from jcontour.native.lanes import (
    WIDTH,
    add_products,
    dot,
    fma,
    gathered,
    load,
    root,
    scatter,
    spread,
    store,
    where_less,
)


@numba.njit
def _worked_out(a, b, out):
    one, other, half = load(a, 0), load(b, 0), spread(0.5)
    store(out, 0, one + other)
    store(out, 1, one - other)
    store(out, 2, one * other)
    store(out, 3, one / other)
    store(out, 4, root(one))
    store(out, 5, fma(one, other, half))
    store(out, 6, where_less(one, other, half, one))


def test_arithmetic_with_numbers_that_are_none():
    random = np.random.default_rng(0)
    a, b, out = random.uniform(0.1, 2, WIDTH), random.uniform(0.1, 2, WIDTH), np.zeros(7 * WIDTH)
    a[3], b[5] = np.nan, np.nan
    _worked_out(a, b, out)
    with np.errstate(invalid="ignore"):
        wanted = [a + b, a - b, a * b, a / b, np.sqrt(a), a * b + 0.5, np.where(a < b, 0.5, a)]
    np.testing.assert_allclose(out.reshape(7, WIDTH), wanted, rtol=1e-15)


@numba.njit
def _there_and_back(source, target, first, count, size):
    found = gathered(source, first, count, size)
    scatter(found, target, first, count, size)
    return found


def test_lanes_without_a_problem_hold_the_last_one_and_are_not_written():
    source = np.arange(33.0)  # eleven problems of three numbers
    target = np.full(33, -1.0)
    found = _there_and_back(source, target, 8, 11, 3).reshape(3, WIDTH)
    np.testing.assert_array_equal(found[:, :3], source[24:].reshape(3, 3).T)
    np.testing.assert_array_equal(found[:, 3:], np.tile(source[30:, None], 5))
    np.testing.assert_array_equal(target, np.r_[np.full(24, -1.0), source[24:]])


@numba.njit
def _row(out, start, left, right, rows, columns):
    add_products(out, 0, start, 0, left, 0, 2, spread(-1.0), right, 0, 9, rows, columns)
    store(out, columns, dot(left, 0, right, 1, 3, load(start, 0)))


def test_products_of_a_row_with_any_number_of_columns():
    random = np.random.default_rng(1)
    left, right = random.standard_normal((8, WIDTH)), random.standard_normal((4 * 9, WIDTH))
    start = random.standard_normal((9, WIDTH))
    for columns in range(1, 10):
        out = np.zeros((10, WIDTH))
        _row(out.ravel(), start.ravel(), left.ravel(), right.ravel(), 4, columns)
        product = np.einsum("kl,kjl->jl", left[::2], right.reshape(4, 9, WIDTH)[:, :columns])
        np.testing.assert_allclose(out[:columns], start[:columns] - product, atol=1e-14)
        summed = start[0] + (left[:3] * right[1:4]).sum(axis=0)
        np.testing.assert_allclose(out[columns], summed, atol=1e-14)
