"""Eight numbers as one value, in code that Numba compiles: one of each of eight problems.

An array of lanes is a flat float64 array in which the eight numbers of an entry lie side by side;
`load` and `store` count in entries. Arithmetic is that of the vector units; a loop over entries
reads as if it were of one problem.
"""

import inspect
import operator
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

WIDTH = 8
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)


def part(function: Callable) -> Any:
    """Decorator: a function that is compiled into those that call it."""
    bare = inspect.unwrap(function)  # without what a checker of annotations puts around it
    return numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, error_model="numpy")(bare)


class LanesType(types.Type):
    """Numba's type of the value."""

    def __init__(self):
        super().__init__(name=f"Lanes{WIDTH}")


lanes = LanesType()


@register_model(LanesType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        super().__init__(manager, numba_type, _VECTOR)


@intrinsic
def load(context, array, entry) -> Any:
    """Entry of an array of lanes."""

    def code(context, builder, signature, values):
        vector = builder.load(_place(context, builder, signature.args[0], *values[:2]))
        vector.align = 8
        return vector

    return lanes(array, types.intp), code


@intrinsic
def store(context, array, entry, value) -> Any:
    """Set an entry of an array of lanes."""

    def code(context, builder, signature, values):
        place = _place(context, builder, signature.args[0], *values[:2])
        builder.store(values[2], place).align = 8
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), code


def _place(context, builder, array_type, array, entry):
    data = context.make_array(array_type)(context, builder, array).data
    first = builder.mul(entry, ir.Constant(entry.type, WIDTH))
    return builder.bitcast(builder.gep(data, [first]), _VECTOR.as_pointer())


@intrinsic
def spread(context, number) -> Any:
    """The same number in every lane."""

    def code(context, builder, signature, values):
        empty = ir.Constant(_VECTOR, ir.Undefined)
        one = builder.insert_element(empty, values[0], ir.Constant(ir.IntType(32), 0))
        everywhere = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        return builder.shuffle_vector(one, empty, everywhere)

    return lanes(types.float64), code


@intrinsic
def fma(context, one, other, added) -> Any:
    """`one * other + added`, rounded once."""

    def code(context, builder, signature, values):
        return builder.call(_function(builder, "fma", 3), values)

    return lanes(lanes, lanes, lanes), code


@intrinsic
def root(context, value) -> Any:
    """Square root."""

    def code(context, builder, signature, values):
        return builder.call(_function(builder, "sqrt", 1), values)

    return lanes(lanes), code


@intrinsic
def where_less(context, one, other, yes, no) -> Any:
    """`yes` where `one` is less than `other`, `no` elsewhere and where one of them is NaN."""

    def code(context, builder, signature, values):
        return builder.select(builder.fcmp_ordered("<", *values[:2]), *values[2:])

    return lanes(lanes, lanes, lanes, lanes), code


def _function(builder, name: str, arguments: int):
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * arguments)
    return cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")


def _arithmetic(operation, instruction: str) -> None:
    @cast(Callable, infer_global)(operation)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            if len(args) == 2 and all(isinstance(one, LanesType) for one in args):
                return signature(lanes, lanes, lanes)
            return None

    @lower_builtin(operation, lanes, lanes)
    def _code(context, builder, signature, values):
        return getattr(builder, instruction)(*values)


for _operation, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _arithmetic(_operation, _instruction)


@part
def most(one, other):
    """Larger of two numbers, the first where they cannot be compared."""
    return where_less(one, other, other, one)


@part
def size_of(number):
    """Absolute value."""
    return most(number, spread(0.0) - number)


def drop_stale(folder: Path, *sources: Path) -> None:
    """Delete what Numba has kept of a folder's modules from before one of the sources was changed.

    Numba looks at a function's own file, not at the files of what is compiled into it. Where it
    keeps its code elsewhere (`NUMBA_CACHE_DIR`), that has to be deleted by hand.
    """
    compiler = Path(__file__).parents[1] / "_compiled.py"
    changed = max(source.stat().st_mtime for source in (compiler, *sources))
    for kept in (folder / "__pycache__").glob("*.nb[ic]"):
        with suppress(OSError):  # another process was quicker, or nothing may be deleted here
            if kept.stat().st_mtime < changed:
                kept.unlink()
