"""Lanes and batches of the GPU kernels: a lane for every member, batch axes behind the others.

Every `vmap` puts its axis behind those of the arrays that it touches, the outermost last, and
leaves the others as they are: what does not differ between members is neither copied nor moved. The
lane of member b at step t has the number t B + b. Lanes beyond the last one do its work again and
write the same numbers, so nothing is masked.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import prod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jax.experimental import pallas as pl
from jax.experimental.pallas import triton
from jaxtyping import Array

from jcontour.kernels.dispatch import on_gpu

LANES = 128  # of one program, one thread each
WARP = 32
MOST_NUMBERS = 2**31  # an array that a kernel sees is indexed with 32 bits


class Operand(NamedTuple):
    """An array and the batch axes at its end, by number: 0 is that of the innermost `vmap`."""

    array: Array
    axes: tuple[int, ...] = ()

    @property
    def core(self) -> tuple[int, ...]:
        """Shape without the batch."""
        return self.array.shape[: self.array.ndim - len(self.axes)]

    def fixed(self) -> "Operand":
        """Rows of numbers that hold for the whole run: (row, member)."""
        return Operand(self.array.reshape(prod(self.core), -1), self.axes)

    def timed(self) -> "Operand":
        """Rows of numbers for every sample: (row, sample and member).

        The samples are on the last axis but the batch.
        """
        return Operand(self.array.reshape(prod(self.core[:-1]), -1), self.axes)

    def over(self, batch: "Batch") -> "Operand":
        """Operand with all axes of a batch, the same numbers along those it does not have."""
        places = zip(batch.together, batch.sizes, strict=True)
        sizes = (size if axis in self.axes else 1 for axis, size in places)
        array = self.array.reshape(*self.core, *sizes)
        return Operand(jnp.broadcast_to(array, (*self.core, *batch.sizes)), batch.together)


class Rows(NamedTuple):
    """An operand as the lanes of a program read it."""

    ref: Any
    member: Any  # of the operand's own axes, for every lane
    members: int

    def fixed(self, row):
        """Number that holds for the whole run."""
        return self.ref[row, self.member]

    def sample(self, row, sample):
        """Number of one sample."""
        return self.ref[row, sample * self.members + self.member]


class Batch(NamedTuple):
    """Batch axes of several operands, static.

    Attributes:
        together: axes that they have together, the innermost first.
        sizes: sizes of these axes.
        axes: axes of every operand.
    """

    together: tuple[int, ...]
    sizes: tuple[int, ...]
    axes: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, operands: Sequence[Operand]) -> "Batch":
        """Batch of several operands."""
        sizes: dict[int, int] = {}
        for array, axes in operands:
            sizes |= zip(axes, array.shape[array.ndim - len(axes) :], strict=True)
        together = tuple(sorted(sizes))
        return cls(
            together, tuple(sizes[axis] for axis in together), tuple(axes for _, axes in operands)
        )

    @property
    def members(self) -> int:
        """Size of the whole batch."""
        return prod(self.sizes)

    def rows(self, refs, member) -> list[Rows]:
        """Operands for lanes of these members."""
        pairs = zip(refs, self.axes, strict=True)
        return [Rows(ref, *self._own(axes, member)) for ref, axes in pairs]

    def _own(self, axes: tuple[int, ...], member) -> tuple[Any, int]:
        """Member of an operand that belongs to a member of the batch, and how many it has."""
        if axes == self.together:
            return member, self.members
        own, stride = 0, 1
        for axis, size in zip(reversed(self.together), reversed(self.sizes), strict=True):
            if axis in axes:
                own, stride = own + member % size * stride, stride * size
            member = member // size
        return own, stride


@dataclass(frozen=True)
class Flat:
    """Rows of numbers behind one index: half of the instructions of two, which all take compiling.

    Attributes:
        ref: the numbers.
        columns: of a row.
    """

    ref: Any
    columns: int

    @property
    def dtype(self) -> Any:
        """Type of the numbers."""
        return self.ref.dtype

    def __getitem__(self, place):
        return self.ref[self._flat(*place)]

    def __setitem__(self, place, numbers) -> None:
        self.ref[self._flat(*place)] = numbers

    def _flat(self, row, column):
        return column if isinstance(row, int) and row == 0 else row * self.columns + column


class Lanes(NamedTuple):
    """Lanes of one program: flat number, step and member of the batch, (L,) each."""

    number: Array
    step: Array
    member: Array

    @classmethod
    def of(cls, program, steps: int, members: int, count: int = LANES) -> "Lanes":
        """Lanes program * count onwards."""
        number = program * count + jnp.arange(count, dtype=jnp.int32)
        number = jnp.minimum(number, steps * members - 1)
        return cls(number, number // members, number % members)


def processors() -> int:
    """Number of multiprocessors of the device; 128 where JAX does not know."""
    return getattr(jax.devices()[0], "core_count", None) or 128


def launch(
    kernel: Callable,
    programs: int,
    operands: Sequence[Operand],
    results: Sequence[tuple[int, ...]],
    lanes: int = LANES,
) -> Any:
    """Run `kernel` with every array whole; without a GPU it is interpreted, for tests.

    Operands and results are rows of numbers (row, column), or plain rows (column,).
    """
    dtype = operands[0].array.dtype
    shapes = [*(operand.array.shape for operand in operands), *results]

    def flat_kernel(*refs):
        pairs = zip(refs, shapes, strict=True)
        kernel(*(Flat(ref, shape[1]) if len(shape) == 2 else ref for ref, shape in pairs))

    # JAX means to replace its Triton backend; the other one has no float64
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The Pallas Triton backend is deprecated")
        found = pl.pallas_call(
            flat_kernel,
            out_shape=[jax.ShapeDtypeStruct((prod(shape),), dtype) for shape in results],
            grid=(programs,),
            interpret=not on_gpu(),
            compiler_params=triton.CompilerParams(num_warps=max(lanes // WARP, 1), num_stages=1),
        )(*(operand.array.reshape(-1) for operand in operands))
    return [array.reshape(shape) for array, shape in zip(found, results, strict=True)]


def batch_last(function: Callable[..., list[Array]]) -> Callable[..., list[Array]]:
    """Function of arrays under any number of `vmap`s, from a function of operands.

    The results of `function` have every batch axis behind.
    """

    def under(axes: tuple[tuple[int, ...], ...], depth: int):
        @custom_vmap
        def mapped(*arrays):
            return function(*(Operand(*both) for both in zip(arrays, axes, strict=True)))

        @mapped.def_vmap
        def one_more(_, touched, *arrays):
            arrays, deeper = list(arrays), list(axes)
            for i, moved in enumerate(touched):
                if moved:
                    arrays[i], deeper[i] = jnp.moveaxis(arrays[i], 0, -1), (*axes[i], depth)
            results = under(tuple(deeper), depth + 1)(*arrays)
            return [jnp.moveaxis(array, -1, 0) for array in results], [True] * len(results)

        return mapped

    return lambda *arrays: under(((),) * len(arrays), 0)(*arrays)


def for_every(axes: set[int], function: Callable, operands: Sequence[Operand]) -> Any:
    """Results of a function of arrays, for one member at a time of some batch axes.

    All other batch axes stay behind in arrays and results.
    """
    left = set(Batch.of(operands).together) - axes

    def behind(own, axis: int) -> int:
        return -1 - sum(other > axis for other in left.intersection(own))

    for axis in sorted(axes):
        places = tuple(behind(own, axis) if axis in own else None for _, own in operands)
        function = jax.vmap(function, in_axes=places, out_axes=behind(left, axis))
    return function(*(operand.array for operand in operands))


def in_pieces(
    function: Callable[..., list[Array]], operands: Sequence[Operand], rows: int
) -> list[Array]:
    """Results of a function of operands, on halves of the batch where the whole is too large.

    The batch is cut along its longest axis until `rows` numbers per member can be indexed.
    """
    batch = Batch.of(operands)
    size, longest = max(zip(batch.sizes, batch.together, strict=True), default=(1, 0))
    if rows * batch.members < MOST_NUMBERS or size == 1:
        return function(*operands)

    def cut(operand: Operand, first: int, last: int) -> Operand:
        if longest not in operand.axes:
            return operand
        axis = len(operand.core) + operand.axes.index(longest)
        return Operand(jax.lax.slice_in_dim(operand.array, first, last, axis=axis), operand.axes)

    pieces = []
    for part in pairwise((0, size // 2, size)):
        halves = [cut(operand, *part) for operand in operands]
        pieces.append(in_pieces(function, halves, rows))
    behind = batch.together.index(longest) - len(batch.together)
    return [jnp.concatenate(pair, axis=behind) for pair in zip(*pieces, strict=True)]


def vectors(values, like: Array) -> tuple[Array, ...]:
    """Numbers that a loop carries, each as a vector over the lanes, known zeros too."""
    return tuple(jnp.broadcast_to(jnp.asarray(value, like.dtype), like.shape) for value in values)


def dense(bar: Any) -> Array:
    """Cotangent as an array, whether anything reached it or not."""
    shape, dtype = bar.shape, bar.dtype
    return jnp.zeros(shape, dtype) if isinstance(bar, SymbolicZero) else bar
