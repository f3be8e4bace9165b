"""The interior point on a CPU: the kernels of a GPU over eight problems at a time.

Their arithmetic is written out as a program of this processor, with the numbers of eight problems
in its second-level cache. XLA, which would call each small operation of a sweep by itself, calls
it; its threads share the groups of eight.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.kernels.arithmetic import is_finite
from jcontour.native.calls import shared_call
from jcontour.native.numbers import WIDTH, Number, Whole, value
from jcontour.native.side_by_side import Column, Eight, with_memory
from jcontour.native.straight_line import counted, subprogram, whole
from jcontour.qp.lanes.check import check
from jcontour.qp.lanes.found import NAMES, RESULTS, Found, problem_rows, rows_of
from jcontour.qp.lanes.iteration import ITERATION
from jcontour.qp.lanes.kernel import Kernel, Sizes
from jcontour.qp.lanes.start import START
from jcontour.qp.path import MOST, rounding
from jcontour.qp.staged import StagedQP

SQUARES = "H", "H_end"  # symmetric: their lower triangles are kept


def found(qp: StagedQP, guess) -> Found:
    """The answer as the readable solver finds it.

    Args:
        qp: the problem, of float64 numbers, with one limited row at least.
        guess: controls to begin with.
    """
    (N, r), n, p = qp.lower.shape, qp.x0.size, qp.B.shape[1]
    sizes = Sizes(N, n, p, r)
    rows = rows_of(sizes)
    shapes = [jax.ShapeDtypeStruct((rows[name],), jnp.float64) for name in RESULTS]
    numbers = _program(sizes)(shapes, *qp, guess)
    return Found.of(sizes, dict(zip(RESULTS, numbers, strict=True)))


@lru_cache
def _program(sizes: Sizes):
    name = "jcontour_interior_point_" + "_".join(map(str, sizes))
    return shared_call(name, partial(_groups, sizes), partial(_write, sizes))


def _members(sizes: Sizes, builder, arguments):
    return builder.sdiv(arguments(NAMES.index("x0")).size(), whole(sizes.n))


def _groups(sizes: Sizes, builder, arguments, _):
    members = _members(sizes, builder, arguments)
    return builder.sdiv(builder.add(members, whole(WIDTH - 1)), whole(WIDTH))


def _write(sizes: Sizes, builder, group, arguments, results) -> None:
    """Write the program of eight problems."""
    eight = Eight.of(builder, group, _members(sizes, builder, arguments))
    rows, places = rows_of(sizes), _places(sizes)

    def to_results(number: Callable) -> None:
        for k, name in enumerate(RESULTS):

            def one(entry, _, k=k, name=name):
                found = number(name, Whole(builder, entry))
                eight.scatter(results(k), rows[name], entry, found)

            counted(builder, whole(rows[name]), one)

    def solve(memory) -> None:
        at = Columns(builder, memory, places)
        for k, name in enumerate(NAMES):
            gather = _gather_triangles if name in SQUARES else _gather
            gather(sizes, eight, name, arguments(k), getattr(at, name))
        _solve(sizes, at, memory)
        to_results(lambda name, entry: getattr(at, name)[entry])

    unknown = Number(builder, value(float("nan")))
    with_memory(builder, places[""], solve, lambda: to_results(lambda *_: unknown))


def _places(sizes: Sizes) -> dict[str, int]:
    """Where each column begins in the memory of eight problems; that of no name is its end."""
    rows = problem_rows(sizes) | rows_of(sizes)
    ends = np.cumsum([0, *rows.values()]).tolist()
    return dict(zip((*rows, ""), ends, strict=True))


class Columns(SimpleNamespace):
    """Columns of eight problems by name, and loops over their stages."""

    tiny = float(np.finfo(float).tiny ** 0.5)
    rounding = rounding(float)

    def __init__(self, builder, memory, places: dict[str, int]):
        self.builder = builder
        super().__init__(**{name: Column.at(builder, memory, k) for name, k in places.items()})

    def loop(self, count: int, body: Callable, begun: Sequence, down: bool = False) -> list:
        """Carry numbers through the stages: `body(j, carried)`."""

        def step(j, carried):
            numbers = [Number(self.builder, one) for one in carried]
            return [value(number) for number in body(Whole(self.builder, j), numbers)]

        first = [value(number) for number in begun]
        ends = counted(self.builder, whole(count), step, first, down)
        return [Number(self.builder, end) for end in ends]

    def backwards(self, count: int, body: Callable, begun: Sequence) -> list:
        """The same from the last stage to the first."""
        return self.loop(count, body, begun, down=True)


def _gather(sizes: Sizes, eight: Eight, name: str, row, column: Column) -> None:
    """Numbers of the problems side by side."""
    size = problem_rows(sizes)[name]

    def one(k, _) -> None:
        column[Whole(eight.builder, k)] = eight.gathered(row, size, k)

    counted(eight.builder, whole(size), one)


def _gather_triangles(sizes: Sizes, eight: Eight, name: str, row, column: Column) -> None:
    """Lower triangles of symmetric matrices, stage by stage."""
    builder = eight.builder
    stages, width = (sizes.N, sizes.v) if name == "H" else (1, sizes.n)

    def stage(j, kept):
        def line(i, kept):
            begin = builder.mul(builder.add(builder.mul(j, whole(width)), i), whole(width))

            def one(k, kept):
                place = builder.add(begin, k)
                column[Whole(builder, kept[0])] = eight.gathered(row, stages * width**2, place)
                return [builder.add(kept[0], whole(1))]

            return counted(builder, builder.add(i, whole(1)), one, kept)

        return counted(builder, whole(width), line, kept)

    counted(builder, whole(stages), stage, [whole(0)])


def _solve(sizes: Sizes, at: Columns, memory) -> None:
    """Go along the path as long as a problem is not at its end."""
    builder = at.builder

    def run(kernels: Sequence[Kernel]) -> None:
        for kernel in kernels:
            builder.call(_function(kernel, sizes, builder.module), [memory])

    def iterate(*_) -> None:
        with builder.if_then((at.open[0] > 0).anywhere()):
            run(ITERATION)

    run(START)
    counted(builder, whole(MOST), iterate)
    run((check,))


def _function(kernel: Kernel, sizes: Sizes, module):
    """Function of the memory that runs a kernel."""
    name = kernel.body.__name__.strip("_")

    def write(builder, memory) -> None:
        at: Any = Columns(builder, memory, _places(sizes))
        if not kernel.softens:
            at.soft = True
            kernel.body(sizes, at)
            return
        gives = is_finite(at.penalty[0])
        for k in range(1, sizes.r):
            gives = gives | is_finite(at.penalty[k])
        with builder.if_else(gives.anywhere()) as branches:
            for branch, at.soft in zip(branches, (True, False), strict=True):
                with branch:
                    kernel.body(sizes, at)

    return module.globals.get(name) or subprogram(module, name, 1, write)
