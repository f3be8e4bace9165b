"""Times of programs: compiling, running, memory."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

FEWEST, MOST = 3, 20  # repetitions of a timed call
SECONDS = 1.0  # that the repetitions may take together


class Timing(NamedTuple):
    """Times and memory of one program."""

    compiling: float  # [s]
    running: float  # [s] median
    memory: int  # [bytes] arguments, results and everything between


def timed(function: Callable, *arguments) -> Timing:
    """Compile, run once, then run until there are enough times."""
    begin = time.perf_counter()
    program = jax.jit(function).lower(*arguments).compile()
    compiling = time.perf_counter() - begin

    def call():
        return jax.block_until_ready(program(*arguments))

    call()
    spent: list[float] = []
    while len(spent) < FEWEST or (len(spent) < MOST and sum(spent) < SECONDS):
        spent.append(seconds(call))
    analysis: Any = program.memory_analysis()
    kinds = ("temp", "argument", "output") if analysis else ()
    memory = sum(getattr(analysis, f"{kind}_size_in_bytes") for kind in kinds)
    return Timing(compiling, float(np.median(spent)), memory)


def seconds(call: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    """Time of a call on a clock, wall time by default."""
    begin = clock()
    call()
    return clock() - begin
