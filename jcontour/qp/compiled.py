"""Numba's compiler, with its cache where there is a place for one."""

from collections.abc import Callable
from typing import TypeVar

import numba

Function = TypeVar("Function", bound=Callable)


def compiled(function: Function) -> Function:
    """The function compiled at its first call, and kept on disk for the next process; without a writable place it is compiled anew."""
    try:
        return numba.njit(cache=True)(function)  # type: ignore  # a dispatcher that is called like the function
    except RuntimeError:  # numba found no place for its cache
        return numba.njit(function)  # type: ignore
