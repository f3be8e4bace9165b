"""Whole numbers and floats at an address, in code that Numba compiles."""

from typing import Any

from numba import types
from numba.extending import intrinsic
from numba.np.numpy_support import carray

from jcontour.native.lanes import part


def _pointer(number):
    @intrinsic
    def pointer(context, address) -> Any:
        def code(context, builder, signature, values):
            return builder.inttoptr(values[0], context.get_value_type(signature.return_type))

        return types.CPointer(number)(types.intp), code

    return pointer


floats, longs, ints = (_pointer(kind) for kind in (types.float64, types.int64, types.int32))


@part
def word(address):
    """The whole number of eight bytes at an address."""
    return carray(longs(address), 1)[0]
