"""Programs that XLA calls by a name, without a compiler and without Python.

XLA hands over a call frame (`interface`): a structure with the addresses of the arguments' and the
results' numbers and of their extents.
"""

import ctypes
from collections.abc import Callable
from functools import partial
from threading import Lock
from typing import Any

import jax
import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from jcontour.native import interface
from jcontour.native.numbers import INT, LONG
from jcontour.native.straight_line import Row, subprogram, whole
from jcontour.native.threads import MINOR_SEEN, share

_KEPT = {}  # what is compiled, by name: XLA knows but its address
_LOCK = Lock()  # so that nothing is compiled twice, and freed while XLA has its address


def straight_call(name: str, write: Callable) -> Callable:
    """A program that XLA knows by a name on the CPU, from the function that writes it.

    `write(builder, arguments, results)` is called with functions from a number to a `Row`, if the
    name is new. The call takes shapes of results and arrays, all of float64; under `vmap` it is
    called for one member after the other. Who calls it has to see to the sizes.
    """

    def body(builder: ir.IRBuilder, frame) -> None:
        write(builder, *_rows(builder, frame))

    return _call(name, partial(_entry, body), "sequential")


def shared_call(name: str, parts: Callable, write: Callable) -> Callable:
    """The same in parts that do not know of each other, which XLA's threads share.

    `parts(builder, arguments, results)` finds how many there are, and `write(builder, k, arguments,
    results)` writes part k. A `vmap` hands over one more axis in front of every argument and
    result. Rows of the results' numbers are all of them, whatever the axes.
    """

    def program(module: ir.Module, name: str) -> None:
        def one(builder: ir.IRBuilder, frame, k) -> None:
            write(builder, k, *_rows(builder, frame))

        part = subprogram(module, "part", 2, one)

        def body(builder: ir.IRBuilder, frame) -> None:
            share(builder, frame, parts(builder, *_rows(builder, frame)), part)

        _entry(body, module, name)

    return _call(name, program, "broadcast_all")


def alone() -> bool:
    """Whether shared calls have run on one thread, as XLA's interface is not the one known here."""
    places = [engine.get_global_value_address(MINOR_SEEN) for engine in _KEPT.values()]
    seen = {ctypes.c_int32.from_address(place).value for place in places if place}
    return not seen.issubset(interface.LAYOUTS)


def _call(name: str, write: Callable, vmap_method: str) -> Callable:
    with _LOCK:
        if name not in _KEPT:
            module = ir.Module(name)
            write(module, name)
            engine = _engine(str(module))
            address = engine.get_function_address(name)
            jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), "cpu")
            _KEPT[name] = engine

    def call(results, *arrays):
        assert all(array.dtype == np.float64 for array in (*jax.tree.leaves(results), *arrays))
        return jax.ffi.ffi_call(name, results, vmap_method=vmap_method)(*arrays)

    return call


def _entry(write: Callable, module: ir.Module, name: str) -> None:
    """Function of a frame; `write(builder, frame)` writes it."""
    function = ir.Function(module, ir.FunctionType(LONG, [LONG]), name)
    builder, frame = ir.IRBuilder(function.append_basic_block()), function.args[0]
    _answer(builder, frame)
    write(builder, frame)
    builder.ret(whole(0))


def _rows(builder: ir.IRBuilder, frame) -> list[Callable[[int], Row]]:
    """Arguments and results of a frame, by number."""

    def row(place: int, k: int) -> Row:
        buffer = interface.word(builder, interface.word(builder, frame, place), 8 * k)
        places = interface.DATA, interface.EXTENTS, interface.RANK
        return Row(builder, *(interface.word(builder, buffer, place) for place in places))

    return [partial(row, place) for place in (interface.ARGUMENTS, interface.RESULTS)]


def _answer(builder: ir.IRBuilder, frame) -> None:
    """Return at once from a call that only asks for the version, with the answer."""
    extension = interface.word(builder, frame, interface.EXTENSION)
    with builder.if_then(builder.icmp_signed("!=", extension, whole(0))):
        kind = builder.load(interface.place(builder, extension, interface.KIND, INT))
        asks = builder.icmp_signed("==", kind, INT(interface.IS_METADATA))
        with builder.if_then(asks):
            metadata = interface.word(builder, extension, interface.METADATA)
            minor = interface.own_minor(builder, frame)  # they only add
            for place, number in (
                (interface.MAJOR, INT(0)),
                (interface.MINOR, minor),
                (interface.TRAITS, INT(0)),
            ):
                builder.store(number, interface.place(builder, metadata, place, INT))
            builder.ret(whole(0))


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
    options = llvm.create_pipeline_tuning_options(speed_level=1)
    passes = llvm.create_new_module_pass_manager()
    passes.add_instruction_combine_pass()  # all of level 1 take six times as long, gain nothing
    passes.run(module, llvm.create_pass_builder(machine, options))
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return engine


def _features() -> str:
    """What this processor can do beyond its name; nothing where LLVM cannot tell."""
    try:
        return llvm.get_host_cpu_features().flatten()
    except RuntimeError:
        return ""
