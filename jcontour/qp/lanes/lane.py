"""Numbers that a kernel's lanes work on on a GPU, and the call of such a kernel.

A lane is a problem of the batch, a program is a warp of them. An array has its rows of `WARP`
numbers one after the other, program by program: what a program reads lies together. Members of a
batch may share what is known of the problems; what the iterations change is changed in place. A
warp whose problems are all at an end does nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array

from jcontour.devices import on_gpu
from jcontour.kernels.gpu.lanes import WARP, Batch, Operand, vectors
from jcontour.qp.lanes.kernel import Kernel, Sizes
from jcontour.qp.path import rounding

ROOM = 48 * 1024  # bytes that a program has in the memory beside its processor
IN_REGISTERS = 128 * 4  # bytes of D that a lane takes there: half of its registers


@dataclass(frozen=True)
class Column:
    """Rows of an array, as the lanes have them: where they begin, and how far apart they are."""

    ref: Any
    begin: Array
    apart: int

    def __getitem__(self, row):
        return self.ref[self.begin + row * self.apart]

    def __setitem__(self, row, numbers) -> None:
        numbers = jnp.broadcast_to(jnp.asarray(numbers, self.ref.dtype), self.begin.shape)
        self.ref[self.begin + row * self.apart] = numbers


class Columns(SimpleNamespace):
    """Columns of a kernel by name, and loops over its stages.

    Args:
        dtype: of its numbers.
        columns: by name.
    """

    def __init__(self, dtype: Any, columns: Mapping[str, Column]):
        super().__init__(**columns)
        self.dtype, self.tiny = dtype, float(jnp.finfo(dtype).tiny ** 0.5)
        self.rounding = rounding(dtype)

    def loop(self, count: int, body: Callable, begun: Sequence) -> list:
        """Carry numbers through the stages: `body(j, carried)`."""
        like = jnp.zeros(WARP, self.dtype)

        def step(j, carried):
            return vectors(body(j, list(carried)), like)

        return list(jax.lax.fori_loop(0, count, step, vectors(begun, like)))

    def backwards(self, count: int, body: Callable, begun: Sequence) -> list:
        """The same from the last stage to the first."""
        return self.loop(count, lambda done, carried: body(count - 1 - done, carried), begun)


class Layout(NamedTuple):
    """Where a lane finds its numbers in an array: its rows, and the batch axes that it has."""

    rows: int
    axes: tuple[int, ...]


class Problem(NamedTuple):
    """Arrays of the problems by name, flat, where their numbers are, and the batch."""

    arrays: dict[str, Array]
    layouts: dict[str, Layout]
    batch: Batch

    @classmethod
    def of(cls, operands: Mapping[str, Operand]) -> "Problem":
        """Problems of operands."""
        batch = Batch.of(list(operands.values()))
        rows = {name: operand.fixed() for name, operand in operands.items()}
        arrays = {
            name: (in_warps(array) if axes == batch.together else array).reshape(-1)
            for name, (array, axes) in rows.items()
        }
        layouts = {name: Layout(len(array), axes) for name, (array, axes) in rows.items()}
        return cls(arrays, layouts, batch)

    @property
    def programs(self) -> int:
        """Warps."""
        return -(-self.batch.members // WARP)


def in_warps(array: Array) -> Array:
    """Rows with a column for each member, as (program, row, lane); the last one fills its warp."""
    rows, members = array.shape
    whole = jnp.pad(array, ((0, 0), (0, -members % WARP)), mode="edge")
    return jnp.moveaxis(whole.reshape(rows, -1, WARP), 0, 1)


def by_member(array: Array, rows: int, members: int) -> Array:
    """The other way: rows with a column for each member."""
    return jnp.moveaxis(array.reshape(-1, rows, WARP), 1, 0).reshape(rows, -1)[:, :members]


def run(kernel: Kernel, sizes: Sizes, problem: Problem, work: dict[str, Array]) -> dict[str, Array]:
    """Arrays of the iterations after a kernel."""
    known, reads, writes = (names.split() for names in kernel[1:4])
    layouts = tuple(problem.layouts[name] for name in known)
    dtype = work[writes[0]].dtype
    rows = tuple(work[name].size // (problem.programs * WARP) for name in (*reads, *writes))
    arrays = [problem.arrays[name] for name in known]
    arrays += [work[name] for name in (*reads, *writes)]
    run = _built(kernel, sizes, problem.batch.together, problem.batch.sizes, layouts, rows, dtype)
    return work | dict(zip(writes, run(*arrays), strict=True))


@lru_cache
def _built(kernel: Kernel, sizes: Sizes, together, extents, layouts, rows, dtype) -> Callable:
    """Function of arrays that runs a kernel; without a GPU it is interpreted, for tests."""
    batch = Batch(together, extents, ())
    names = [name for part in kernel[1:4] for name in part.split()]
    kept = kept_beside(kernel, layouts, together, dtype.itemsize)
    small = sizes.r * sizes.v * dtype.itemsize <= IN_REGISTERS
    changed, programs = len(kernel.writes.split()), -(-batch.members // WARP)

    def lanes(*refs):
        program, lane = pl.program_id(0), jnp.arange(WARP, dtype=jnp.int32)
        own = [_column(batch, layout, program, lane) for layout in layouts]
        own += [(program * (WARP * count) + lane, WARP) for count in rows]
        refs, beside = refs[: len(names) - changed] + refs[len(names) :], refs[-len(kept) :]
        refs = refs[: len(names)]
        pairs = zip(names, refs, own, strict=True)
        at = Columns(dtype, {name: Column(ref, *place) for name, ref, place in pairs})

        def work():
            for (name, count), ref in zip(kept, beside if kept else (), strict=True):
                own = Column(ref, program * (WARP * count) + lane, WARP)
                for row in range(count):
                    own[row] = getattr(at, name)[row]
                setattr(at, name, own)
            if hasattr(at, "D") and "D" not in kernel.beside and small:
                at.D = [at.D[k] for k in range(sizes.r * sizes.v)]
            _body(kernel, sizes, at)

        if hasattr(at, "open"):
            pl.when(jnp.any(at.open[0] > 0))(work)
        else:
            work()

    written = [programs * WARP * count for count in rows[len(rows) - changed :]]
    results = [jax.ShapeDtypeStruct((size,), dtype) for size in written]
    first = len(names) - changed
    interpreted = pl.pallas_call(
        lanes,
        out_shape=[
            *results,
            *(jax.ShapeDtypeStruct((programs * WARP * count,), dtype) for _, count in kept),
        ],
        grid=(programs,),
        input_output_aliases={first + k: k for k in range(changed)},
        interpret=True,
    )
    if not on_gpu():
        return lambda *arrays: interpreted(*arrays)[:changed]
    from jcontour.native.gpu_code import call, code_of

    sizes_of = [layout.rows * _lanes_of(batch, layout) for layout in layouts]
    sizes_of += [programs * WARP * count for count in rows]
    arrays = [jax.ShapeDtypeStruct((size,), dtype) for size in sizes_of]
    traced = jax.make_jaxpr(interpreted)(*arrays)
    (found,) = (eqn for eqn in traced.eqns if eqn.primitive.name == "pallas_call")
    name = "qp_" + kernel.body.__name__.strip("_")
    code = code_of(name, found.params["jaxpr"], programs, len(kept), kernel.registers)
    return call(code, programs, results, changed)


def kept_beside(kernel: Kernel, layouts, together, size: int) -> list[tuple[str, int]]:
    """Arrays that a program keeps beside its processor, with their rows: those that find room.

    Args:
        kernel: the kernel.
        layouts: of the arrays of the problem that it reads.
        together: all axes of the batch; what lanes share is not kept.
        size: bytes of a number.
    """
    kept, room = [], ROOM
    for name, layout in zip(kernel.problem.split(), layouts, strict=True):
        taken = layout.rows * WARP * size
        if name in kernel.beside.split() and layout.axes == together and taken <= room:
            kept.append((name, layout.rows))
            room -= taken
    return kept


def _body(kernel: Kernel, sizes: Sizes, at) -> None:
    """Run a kernel's body, without what concerns limits that give way where there are none."""

    def known(soft: bool) -> None:
        at.soft = soft
        kernel.body(sizes, at)

    if kernel.softens:
        soft = sum(jnp.isfinite(at.penalty[k]).astype(jnp.int32) for k in range(sizes.r))
        jax.lax.cond(jnp.any(soft > 0), lambda: known(True), lambda: known(False))
    else:
        known(True)


def _lanes_of(batch: Batch, layout: Layout) -> int:
    if layout.axes == batch.together:
        return -(-batch.members // WARP) * WARP
    size = 1
    for axis, extent in zip(batch.together, batch.sizes, strict=True):
        size *= extent if axis in layout.axes else 1
    return size


def _column(batch: Batch, layout: Layout, program, lane) -> tuple[Any, int]:
    """Where the lanes' numbers of an array of the problems begin, and how far apart rows are."""
    if layout.axes == batch.together:
        return program * (WARP * layout.rows) + lane, WARP
    member = jnp.minimum(program * WARP + lane, batch.members - 1)
    one = batch._replace(axes=(layout.axes,))
    (row,) = one.rows([None], member)
    return jnp.broadcast_to(jnp.asarray(row.member, jnp.int32), lane.shape), row.members
