"""Straight-line programs over eight lanes that XLA calls, written by arithmetic in Python.

A `Number` stands for eight numbers of a program that is being written: what Python does with it
becomes an instruction. Unlike Numba's, such a program costs no second of loading, and LLVM compiles
it for this processor in a tenth of a second. It suits long formulas over the non-zeros of a plant.
"""

from collections.abc import Callable
from functools import partial
from threading import Lock
from typing import Any, NamedTuple

import jax
import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from jcontour.native import interface

WIDTH = 8
_LONG, _INT, _DOUBLE = ir.IntType(64), ir.IntType(32), ir.DoubleType()
_LANES = ir.VectorType(_DOUBLE, WIDTH)
_FUSED = ("contract",)  # a product and a sum become one instruction

_KEPT = {}  # what is compiled, by name: XLA knows but its address
_LOCK = Lock()  # so that nothing is compiled twice, and freed while XLA has its address


class Number:
    """Eight numbers of a program that is being written.

    Args:
        builder: of the program.
        value: the instruction that gives them.
    """

    def __init__(self, builder: ir.IRBuilder, value):
        self.builder, self.value = builder, value

    def __add__(self, other):
        return self._with(self.builder.fadd, self.value, _value(other))

    def __sub__(self, other):
        return self._with(self.builder.fsub, self.value, _value(other))

    def __mul__(self, other):
        return self._with(self.builder.fmul, self.value, _value(other))

    def __rtruediv__(self, other):
        return self._with(self.builder.fdiv, _value(other), self.value)

    def __neg__(self):
        return Number(self.builder, self.builder.fneg(self.value))

    __radd__, __rmul__ = __add__, __mul__

    def _with(self, instruction: Callable, *values) -> "Number":
        return Number(self.builder, instruction(*values, flags=_FUSED))


def _value(number):
    known = isinstance(number, (int, float))
    return ir.Constant(_LANES, [float(number)] * WIDTH) if known else number.value


class Row(NamedTuple):
    """Numbers of an argument, of a result or of memory, flat, as a program has them."""

    builder: ir.IRBuilder
    first: Any  # address of the numbers
    extents: Any = None  # their address

    def lanes(self, place) -> Number:
        """Eight numbers side by side, from a place on."""
        return Number(self.builder, self.builder.load(self._at(place, _LANES), align=8))

    def everywhere(self, place) -> Number:
        """The number at a place, in every lane."""
        empty = ir.Constant(_LANES, ir.Undefined)
        number = self.builder.load(self._at(place, _DOUBLE))
        one = self.builder.insert_element(empty, number, ir.Constant(_INT, 0))
        zeros = ir.Constant(ir.VectorType(_INT, WIDTH), [0] * WIDTH)
        return Number(self.builder, self.builder.shuffle_vector(one, empty, zeros))

    def write(self, place, number) -> None:
        """Write eight numbers from a place on."""
        self.builder.store(_value(number), self._at(place, _LANES), align=8)

    def extent(self, axis: int):
        """Extent of an axis."""
        place = self.builder.add(self.extents, whole(8 * axis))
        return self.builder.load(self.builder.inttoptr(place, _LONG.as_pointer()))

    def _at(self, place, kind):
        place = whole(place) if isinstance(place, int) else place
        address = self.builder.add(self.first, self.builder.mul(place, whole(8)))
        return self.builder.inttoptr(address, kind.as_pointer())


def whole(number: int) -> ir.Constant:
    """A whole number that is known."""
    return ir.Constant(_LONG, number)


def memory(builder: ir.IRBuilder, numbers: int) -> Row:
    """Room for so many times eight numbers."""
    room = builder.alloca(_LANES, numbers)
    return Row(builder, builder.ptrtoint(room, _LONG))


def counted_down(builder: ir.IRBuilder, count, body: Callable) -> None:
    """Write a loop: `body(k)` for k = count - 1 down to 0."""
    function = builder.function
    begin, inside, behind = (function.append_basic_block() for _ in range(3))
    before = builder.block
    builder.branch(begin)
    builder.position_at_end(begin)
    left = builder.phi(_LONG)
    left.add_incoming(count, before)
    builder.cbranch(builder.icmp_signed(">", left, whole(0)), inside, behind)
    builder.position_at_end(inside)
    k = builder.sub(left, whole(1))
    body(k)
    left.add_incoming(k, builder.block)
    builder.branch(begin)
    builder.position_at_end(behind)


def straight_call(name: str, write: Callable) -> Callable:
    """A program that XLA knows by a name on the CPU, from the function that writes it.

    `write(builder, arguments, results)` is called with functions from a number to a `Row`, if the
    name is new. The call takes shapes of results and arrays, all of float64; under `vmap` it is
    called for one member after the other. Who calls it has to see to the sizes.
    """
    with _LOCK:
        if name not in _KEPT:
            engine = _compiled(name, write)
            address = engine.get_function_address(name)
            jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), "cpu")
            _KEPT[name] = engine

    def call(results, *arrays):
        assert all(array.dtype == np.float64 for array in (*jax.tree.leaves(results), *arrays))
        return jax.ffi.ffi_call(name, results, vmap_method="sequential")(*arrays)

    return call


def _compiled(name: str, write: Callable) -> Any:
    module = ir.Module(name)
    function = ir.Function(module, ir.FunctionType(_LONG, [_LONG]), name)
    builder, frame = ir.IRBuilder(function.append_basic_block()), function.args[0]
    _answer(builder, frame)

    def row(place: int, k: int) -> Row:
        buffer = _word(builder, _word(builder, frame, place), 8 * k)
        data, extents = interface.DATA, interface.EXTENTS
        return Row(builder, _word(builder, buffer, data), _word(builder, buffer, extents))

    arguments, results = (partial(row, place) for place in (interface.ARGUMENTS, interface.RESULTS))
    write(builder, arguments, results)
    builder.ret(whole(0))
    return _engine(str(module))


def _answer(builder: ir.IRBuilder, frame) -> None:
    """Return at once from a call that only asks for the version, with the answer."""
    extension = _word(builder, frame, interface.EXTENSION)
    with builder.if_then(builder.icmp_signed("!=", extension, whole(0))):
        kind = builder.load(_place(builder, extension, interface.KIND, _INT))
        asks = builder.icmp_signed("==", kind, _INT(interface.IS_METADATA))
        with builder.if_then(asks):
            metadata = _word(builder, extension, interface.METADATA)
            own = _word(builder, frame, interface.INTERFACE)
            minor = builder.load(_place(builder, own, interface.OWN_MINOR, _INT))  # they only add
            for place, number in (
                (interface.MAJOR, _INT(0)),
                (interface.MINOR, minor),
                (interface.TRAITS, _INT(0)),
            ):
                builder.store(number, _place(builder, metadata, place, _INT))
            builder.ret(whole(0))


def _place(builder: ir.IRBuilder, address, offset: int, kind):
    return builder.inttoptr(builder.add(address, whole(offset)), kind.as_pointer())


def _word(builder: ir.IRBuilder, address, offset: int):
    return builder.load(_place(builder, address, offset, _LONG))


def _engine(text: str) -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(text)
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=_features(),
        opt=2,
        jit=True,
    )
    options = llvm.create_pipeline_tuning_options(speed_level=1)  # 3 takes longer, gains nothing
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return engine


def _features() -> str:
    """What this processor can do beyond its name; nothing where LLVM cannot tell."""
    try:
        return llvm.get_host_cpu_features().flatten()
    except RuntimeError:
        return ""
