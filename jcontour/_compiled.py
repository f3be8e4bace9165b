"""Numba's compiler, with its cache where there is a place for one."""

import inspect
from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable)


def compiled(function: Function) -> Function:
    """The function compiled at its first call, and kept on disk for the next process.

    Without a writable place it is compiled anew. The result is numba's dispatcher, which is called
    like the function, and other threads run beside it. It has no entry for C, which would take
    time to compile.
    """
    bare = inspect.unwrap(function)  # without what a checker of annotations puts around it
    try:
        return cast(Function, numba.njit(cache=True, nogil=True, no_cfunc_wrapper=True)(bare))
    except RuntimeError:  # numba found no place for its cache
        return cast(Function, numba.njit(nogil=True, no_cfunc_wrapper=True)(bare))
