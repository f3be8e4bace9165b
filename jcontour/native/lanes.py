"""Eight numbers as one value, in code that Numba compiles: one of each of eight problems.

An array of lanes is a flat float64 array in which the eight numbers of an entry lie side by side;
`load` and `store` count in entries. Arithmetic is that of the vector units; a loop over entries
reads as if it were of one problem.
"""

import inspect
import operator
from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
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
        found = builder.load(_place(context, builder, signature.args[0], *values[:2]))
        found.align = 8
        return found

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
def least(one, other):
    """Smaller of two numbers, the first where they cannot be compared."""
    return where_less(other, one, other, one)


@part
def most(one, other):
    """Larger of two numbers, the first where they cannot be compared."""
    return where_less(one, other, other, one)


@part
def size_of(number):
    """Absolute value."""
    return most(number, spread(0.0) - number)


@part
def gathered(source, first, count, size):
    """Arrays of lanes of the problems from `first` on; the last one fills what is left.

    Args:
        source: numbers of all problems, one problem after the other.
        first: problem of the first lane.
        count: problems there are.
        size: numbers of a problem.
    """
    found = np.empty(size * WIDTH)
    for lane in range(WIDTH):
        start = min(first + lane, count - 1) * size
        for k in range(size):
            found[k * WIDTH + lane] = source[start + k]
    return found


@part
def scatter(values, target, first, count, size):
    """Write the lanes to the problems' own places: the inverse of `gathered`."""
    for lane in range(min(WIDTH, count - first)):
        start = (first + lane) * size
        for k in range(size):
            target[start + k] = values[k * WIDTH + lane]


@part
def add_products(out, to, start, at, left, first, down, sign, right, other, across, count, columns):
    """out[to + j] = start[at + j] + sign * sum_k left[first + down k] right[other + across k + j].

    For j < columns and k < count, in entries: a row of a product of matrices, four columns at once.
    """
    j = 0
    while j + 4 <= columns:
        s0, s1 = load(start, at + j), load(start, at + j + 1)
        s2, s3 = load(start, at + j + 2), load(start, at + j + 3)
        for k in range(count):
            factor = sign * load(left, first + down * k)
            entry = other + across * k + j
            s0 = fma(factor, load(right, entry), s0)
            s1 = fma(factor, load(right, entry + 1), s1)
            s2 = fma(factor, load(right, entry + 2), s2)
            s3 = fma(factor, load(right, entry + 3), s3)
        store(out, to + j, s0)
        store(out, to + j + 1, s1)
        store(out, to + j + 2, s2)
        store(out, to + j + 3, s3)
        j += 4
    while j < columns:
        s0 = load(start, at + j)
        for k in range(count):
            factor = sign * load(left, first + down * k)
            s0 = fma(factor, load(right, other + across * k + j), s0)
        store(out, to + j, s0)
        j += 1


@part
def dot(left, first, right, other, count, start):
    """start + sum_k left[first + k] right[other + k]."""
    for k in range(count):
        start = fma(load(left, first + k), load(right, other + k), start)
    return start
