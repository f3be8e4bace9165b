"""Machine code for NVIDIA's GPUs from a kernel of Pallas, one thread per lane, by LLVM.

Pallas' own way (Triton) looks at all of a kernel for each load and store of it: a sweep over the
stages of a quadratic program, written out number by number, takes minutes to compile. Here it is
translated operation by operation (`gpu_operations`), and takes a second. A kernel may hold vectors
over the lanes, scalars, loops of known length, `lax.cond`, and flat arrays that are read and
written number by number.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import llvmlite.binding as llvm
from llvmlite import ir

from jcontour.native.gpu_operations import LONG, WARP, Array, Writer, register, special

TARGET = "__gpu$xla.gpu.ptx"  # XLA's name of a call that brings its own code
OLDEST = "sm_70"  # the driver translates for what is newer
TRIPLE = "nvptx64-nvidia-cuda"


class Code(NamedTuple):
    """A kernel's code and its name in it."""

    name: str
    text: str


def code_of(name: str, jaxpr, programs: int, kept: int = 0, registers: int = 255) -> Code:
    """Code of a kernel.

    Args:
        name: of the kernel.
        jaxpr: of its body, whose arguments are flat arrays. Each is a parameter of the kernel, an
            address, but the last ones.
        programs: that there are.
        kept: number of these last ones. Every program has numbers of its own in them, as many as
            any other, one program behind the other. They are in the memory beside its processor.
        registers: of a lane at most: with few, a processor has more warps to turn to.
    """
    text = _assembled(str(written(name, jaxpr, programs, kept)))
    return Code(name, text.replace(")\n{", f")\n.maxnreg {registers}\n{{", 1))


def written(name: str, jaxpr, programs: int, kept: int = 0) -> ir.Module:
    """The same as LLVM's operations, before they are assembled."""
    module = ir.Module(name)
    module.triple = TRIPLE
    refs = [atom.aval for atom in jaxpr.invars]
    kind = ir.FunctionType(ir.VoidType(), [LONG] * (len(refs) - kept))
    function = ir.Function(module, kind, name)
    function.calling_convention = "ptx_kernel"
    builder = ir.IRBuilder(function.append_basic_block())
    arrays = [Array(address, "global") for address in function.args]
    behind = refs[len(arrays) :]
    arrays += [_beside(builder, k, ref, programs) for k, ref in enumerate(behind)]
    Writer(builder).run(jaxpr, arrays)
    builder.ret_void()
    return module


def call(code: Code, programs: int, results: Sequence[jax.ShapeDtypeStruct], changed: int):
    """Function of arrays that runs a kernel; the last `changed` become the results in place."""

    def run(*arrays):
        first = len(arrays) - changed
        config = {
            "name": f'"{code.name}"',
            "kernel_type": '"ptx"',
            "kernel_data": '"' + code.text.replace("\n", "\\n").replace("\t", "\\t") + '"',
            **{f"grid_{axis}": programs if axis == "x" else 1 for axis in "xyz"},
            **{f"block_{axis}": WARP if axis == "x" else 1 for axis in "xyz"},
            "shared_mem_bytes": 0,
        }
        text = ", ".join(f"{key} = {value}" for key, value in config.items())
        return jax.ffi.ffi_call(
            TARGET,
            list(results),
            input_output_aliases={first + k: k for k in range(changed)},
            custom_call_api_version=2,
            legacy_backend_config=f"{{{text}}}",
        )(*arrays)

    return run


def _assembled(text: str) -> str:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(cpu=OLDEST, features="+ptx63", opt=2)
    module = llvm.parse_assembly(text)
    module.verify()
    return machine.emit_assembly(module)


def _beside(builder: ir.IRBuilder, k: int, ref, programs: int) -> Array:
    """Room for a program's part of an array; the address is where the first one's would be."""
    _, kind, size = register(ref.dtype)
    (numbers,) = ref.shape
    own = numbers // programs
    room = ir.GlobalVariable(builder.module, ir.ArrayType(kind, own), f"kept_{k}", addrspace=3)
    room.linkage = "internal"
    room.initializer = ir.Constant(room.value_type, ir.Undefined)  # pyright: ignore[reportAttributeAccessIssue]
    before = builder.mul(special(builder, "ctaid.x"), LONG(own * size))
    return Array(builder.sub(builder.ptrtoint(room, LONG), before), "volatile.shared")
