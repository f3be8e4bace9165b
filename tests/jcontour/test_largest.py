"""Largest values and their slopes."""

import jax
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour._largest import largest

VALUES = np.array([[1.0, 5.0, -2.0], [3.0, 2.0, -1.0], [3.0, 1.0, -4.0]])


def test_values_are_those_of_numpy():
    np.testing.assert_array_equal(largest(placed(VALUES)), VALUES.max(axis=0))
    assert float(largest(placed(VALUES.ravel()))) == 5.0


def test_the_slope_is_that_of_one_place():
    """The first one where two are equal."""
    slopes = jax.jit(jax.jacrev(largest))(VALUES)
    wanted = np.zeros((3, 3, 3))
    for column, row in enumerate((1, 0, 1)):
        wanted[column, row, column] = 1.0
    np.testing.assert_array_equal(slopes, wanted)
    np.testing.assert_array_equal(jax.jit(jax.jacfwd(largest))(VALUES), wanted)


def test_nothing_is_zero():
    assert largest(placed(np.zeros((0, 2)))).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("place", [0, 2])
def test_what_is_not_a_number_is_not_hidden(place):
    values = VALUES.copy()
    values[place, 1] = np.nan
    assert np.isnan(np.asarray(largest(placed(values)))[1])
