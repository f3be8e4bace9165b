"""Numbers at an address, against NumPy's own."""

import numba
import numpy as np
from numba.np.numpy_support import carray

from jcontour.native.memory import floats, ints, longs, word


@numba.njit
def _read(address):
    numbers, halves = carray(longs(address), 2), carray(ints(address), 4)
    return word(address + 8), numbers[0], halves[2], carray(floats(address + 16), 1)[0]


def test_whole_numbers_and_floats_at_an_address():
    block = np.array([3, -5, 0])
    block[2:].view(np.float64)[0] = 0.25
    assert _read(block.ctypes.data) == (-5, 3, -5, 0.25)
