"""Calls of Numba's functions from programs of XLA, without a compiler and without Python.

XLA hands over a call frame (`interface`): a structure with the addresses of the arguments' and the
results' numbers and of their extents.
"""

import ctypes
import inspect
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import jax
import jax.numpy as jnp
import numba
import numpy as np
from numba import types
from numba.np.numpy_support import carray

from jcontour.native.interface import (
    ARGUMENTS,
    DATA,
    EXTENSION,
    EXTENTS,
    INTERFACE,
    IS_METADATA,
    KIND,
    MAJOR,
    METADATA,
    MINOR,
    OWN_MINOR,
    RANK,
    RESULTS,
    TRAITS,
)
from jcontour.native.lanes import part
from jcontour.native.memory import floats, ints, longs, word

_KEPT = {}  # what is compiled, by name: XLA knows but its address


@part
def asks(frame):
    """Whether a frame only asks for the version; it is answered."""
    extension = word(frame + EXTENSION)
    if extension == 0 or carray(ints(extension + KIND), 1)[0] != IS_METADATA:
        return False
    metadata = word(extension + METADATA)
    own = carray(ints(word(frame + INTERFACE) + OWN_MINOR), 1)[0]
    carray(ints(metadata + MAJOR), 1)[0] = 0
    carray(ints(metadata + MINOR), 1)[0] = own  # minor versions only add
    carray(ints(metadata + TRAITS), 1)[0] = 0
    return True


@part
def _extents(buffer):
    return carray(longs(word(buffer + EXTENTS)), word(buffer + RANK))


@part
def _numbers(buffer):
    size = 1
    for extent in _extents(buffer):
        size *= extent
    return carray(floats(word(buffer + DATA)), size)


@part
def extent(frame, k, back):
    """Extent of an argument, counted from its last axis, which is 1."""
    found = _extents(word(word(frame + ARGUMENTS) + 8 * k))
    return found[len(found) - back]


@part
def argument(frame, k):
    """Numbers of an argument (float64), flat."""
    return _numbers(word(word(frame + ARGUMENTS) + 8 * k))


@part
def result(frame, k):
    """Numbers of a result (float64), flat, to be written."""
    return _numbers(word(word(frame + RESULTS) + 8 * k))


@part
def spoil(numbers):
    """Set all to NaN."""
    for k in range(len(numbers)):
        numbers[k] = np.nan


def native_call(name: str) -> Callable[[Callable], Callable]:
    """Decorator: a function of a call frame, compiled, that XLA knows by a name on the CPU.

    The function returns zero at once where `asks` answers; else it reads its arguments by
    `argument` and `extent`, and writes every number of its results. What it becomes is called with
    shapes of the results, all of float64, and arrays of float64; a `vmap` hands over one more axis
    in front of every argument and result.

    It may share what it does (`jcontour.native.threads`): then helpers call it too, with the work.

    XLA does not see an error in it, as of memory that there is not: what holds memory calls `spoil`
    on the results first. Who calls it has to see to the sizes.
    """

    def known(function: Callable) -> Callable:
        _KEPT[name] = _compiled_call(inspect.unwrap(function))
        address = ctypes.c_void_p(_KEPT[name].address)
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), "cpu")

        def call(results, *arrays):
            assert all(array.dtype == jnp.float64 for array in arrays)
            return jax.ffi.ffi_call(name, results, vmap_method="broadcast_all")(*arrays)

        return call

    return known


def _compiled_call(function: Callable):
    kind = types.intp(types.intp)
    try:
        return numba.cfunc(kind, cache=True)(function)
    except RuntimeError:  # Numba found no place for its cache
        return numba.cfunc(kind)(function)


def drop_stale(folder: Path, *sources: Path) -> None:
    """Delete what Numba has kept of a folder's modules from before one of the sources was changed.

    Numba looks at a function's own file, not at the files of what is compiled into it. Where it
    keeps its code elsewhere (`NUMBA_CACHE_DIR`), that has to be deleted by hand.
    """
    changed = max(source.stat().st_mtime for source in sources)
    for kept in (folder / "__pycache__").glob("*.nb[ic]"):
        with suppress(OSError):  # another process was quicker, or nothing may be deleted here
            if kept.stat().st_mtime < changed:
                kept.unlink()


_HERE = Path(__file__).parent
drop_stale(_HERE, *_HERE.glob("*.py"))
