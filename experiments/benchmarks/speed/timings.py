"""Times of programs: compiling, running, memory, and the best that the device can do."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.devices import on_gpu

FEWEST, MOST = 3, 20  # repetitions of a timed call
SECONDS = 1.0  # that the repetitions may take together
CHAIN = 512  # multiplications in a row, to measure the rate of arithmetic
SIDE_BY_SIDE = {"cpu": 2**14, "gpu": 2**21}  # to keep the device busy


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
    return Timing(compiling, float(np.median(spent)), _memory(program))


def seconds(call: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    """Time of a call on a clock, wall time by default."""
    begin = clock()
    call()
    return clock() - begin


def arithmetic_rate(dtype: np.dtype) -> float:
    """Measured operations per second of multiplications and additions in registers."""
    run, operations = _fused_chains(dtype) if on_gpu() else _chains(dtype)
    start = jnp.linspace(0.0, 1.0, SIDE_BY_SIDE[jax.default_backend()], dtype=dtype)
    return operations / timed(run, start).running


def _memory(program: Any) -> int:
    found = program.memory_analysis()
    if not found:
        return 0
    return found.temp_size_in_bytes + found.argument_size_in_bytes + found.output_size_in_bytes


def _chains(dtype: np.dtype) -> tuple[Callable, float]:
    def run(x):
        for _ in range(CHAIN):
            x = x * x + x[0]
        return x

    return run, 2.0 * CHAIN * SIDE_BY_SIDE["cpu"]


def _fused_chains(dtype: np.dtype) -> tuple[Callable, float]:
    """Eight chains in every lane, so that none waits for the one before."""
    from jax.experimental import pallas as pl

    from jcontour.kernels.arithmetic import fused
    from jcontour.kernels.gpu.lanes import LANES, Lanes, Operand, launch

    chains, members, unrolled = 8, SIDE_BY_SIDE["gpu"], 16

    def kernel(x, y):
        lanes = Lanes.of(pl.program_id(0), 1, members)
        start = x[lanes.number]

        def body(_, values):
            for _ in range(unrolled):
                values = tuple(fused(value, start, start) for value in values)
            return values

        ends = jax.lax.fori_loop(0, CHAIN, body, tuple(start * (1 + k) for k in range(chains)))
        y[lanes.number] = sum(ends[1:], ends[0])

    def run(x):
        return launch(kernel, members // LANES, [Operand(x)], [(members,)])[0]

    return run, 2.0 * unrolled * CHAIN * chains * members
