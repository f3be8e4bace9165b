"""The operations that are written for a GPU, run on this processor against Pallas' interpreter."""

import ctypes
import re

import jax
import jax.numpy as jnp
import llvmlite.binding as llvm
import numpy as np
import pytest
from jax.experimental import pallas as pl

from jcontour.native.gpu_code import WARP, call, code_of, written

PROGRAMS, ROWS = 2, 3


def kernel(a, flags, counted, b, beside):
    """Numbers, whole numbers, flags, a loop, both branches, memory beside the processor."""
    program, lane = pl.program_id(0), jnp.arange(WARP, dtype=jnp.int32)
    own = program * (ROWS * WARP) + lane
    for row in range(ROWS):
        beside[own + row * WARP] = 2.0 * a[own + row * WARP]

    def body(j, carried):
        total, most = carried
        number = beside[own + j * WARP]
        root = jax.lax.rsqrt(jnp.abs(number) + 1.0) - jnp.sqrt(number**2) / 3.0
        total = jnp.where(jnp.isfinite(number) & ~(number < -1.0), total + root, -total)
        return total, jnp.maximum(most, number)

    begun = jnp.zeros(WARP), jnp.full(WARP, -jnp.inf)
    total, most = jax.lax.fori_loop(0, ROWS, body, begun)
    most = jax.lax.fori_loop(0, 0, lambda _, number: number + 1.0, most)
    short = most.astype(jnp.float32)

    def straight():
        b[own] = total
        b[own + WARP] = most + short.astype(most.dtype)
        b[own + 2 * WARP] = jnp.minimum(most, 0.5) + (lane // 5 + lane % 7).astype(most.dtype)

    def other():
        b[own] = jnp.clip(-total, -1.0, 1.0)
        b[own + WARP] = counted[jnp.minimum(own, 40)] ** 3
        b[own + 2 * WARP] = jnp.where(most == 1.0, 0.0, (total != most).astype(most.dtype))

    jax.lax.cond(jnp.any(flags[program * WARP + lane] > 0), straight, other)


@pytest.fixture(scope="module")
def arrays():
    random = np.random.default_rng(0)
    a = 3 * random.standard_normal(PROGRAMS * ROWS * WARP)
    a[[5, 40, 150]] = np.nan, np.inf, -np.inf
    flags = np.repeat([1.0, -1.0], WARP)
    return a, flags, random.standard_normal(41)


@pytest.fixture(scope="module")
def interpreted():
    size = jax.ShapeDtypeStruct((PROGRAMS * ROWS * WARP,), float)
    return pl.pallas_call(kernel, out_shape=[size, size], grid=(PROGRAMS,), interpret=True)


@pytest.fixture(scope="module")
def jaxpr(interpreted, arrays):
    (eqn,) = jax.make_jaxpr(interpreted)(*arrays).eqns
    return eqn.params["jaxpr"]


def on_this_processor(text):
    """LLVM's program with the GPU's own operations put as functions of this processor."""
    text = re.sub(r'target triple = "[^"]*"', "", text).replace("ptx_kernel", "")
    text = re.sub(
        r'call double asm sideeffect "ld\S+ \$0, \[\$1\+(-?\d+)\];"\s*,\s*"[^"]*"\s*\((.*?)\)',
        r"call double @read(\2, i64 \1)",
        text,
    )
    text = re.sub(
        r'call void asm sideeffect "st\S+ \[\$0\+(-?\d+)\], \$1;"\s*,\s*"[^"]*"\s*\((.*?)\)',
        r"call void @put(\2, i64 \1)",
        text,
    )
    text = text.replace("addrspace(3)", "")
    text = re.sub(r'declare i32 @"llvm.nvvm.read.ptx.sreg.(\w+).x"\(\)', "", text)
    text = re.sub(r'@"llvm.nvvm.read.ptx.sreg.(\w+).x"', r"@\1", text)
    text = re.sub(r'declare i1 @"llvm.nvvm.vote.any.sync"\(.*?\)', "", text)
    text = text.replace('@"llvm.nvvm.vote.any.sync"', "@vote")
    return text + _BESIDE


_BESIDE = """
@lane = global i32 0
@program = global i32 0
define i32 @tid() { %a = load i32, ptr @lane
 ret i32 %a }
define i32 @ctaid() { %a = load i32, ptr @program
 ret i32 %a }
define i1 @vote(i32 %mask, i1 %flag) { ret i1 %flag }
define double @read(i64 %a, i64 %b) { %c = add i64 %a, %b
 %d = inttoptr i64 %c to ptr
 %e = load double, ptr %d
 ret double %e }
define void @put(i64 %a, double %x, i64 %b) { %c = add i64 %a, %b
 %d = inttoptr i64 %c to ptr
 store double %x, ptr %d
 ret void }
"""


def test_operations_are_those_of_pallas(interpreted, jaxpr, arrays):
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    text = on_this_processor(str(written("tried", jaxpr, PROGRAMS, kept=1)))
    machine = llvm.Target.from_default_triple().create_target_machine(opt=0)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(text), machine)
    engine.finalize_object()
    numbers = [*map(np.ascontiguousarray, arrays), np.empty(PROGRAMS * ROWS * WARP)]
    run = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4)(engine.get_function_address("tried"))
    place = [
        ctypes.c_int32.from_address(engine.get_global_value_address(name))
        for name in ("program", "lane")
    ]
    for place[0].value in range(PROGRAMS):
        for place[1].value in range(WARP):
            run(*(array.ctypes.data for array in numbers))
    wanted, _ = interpreted(*arrays)
    assert np.isnan(wanted).any()
    np.testing.assert_allclose(numbers[-1], wanted, rtol=1e-14)


def test_code_has_every_load_and_each_array_in_its_memory(jaxpr):
    text = code_of("tried", jaxpr, PROGRAMS, kept=1, registers=64).text
    assert ".maxnreg 64" in text
    assert text.count("ld.global.f64") == ROWS + 2 and text.count("st.global.f64") == 6
    assert text.count("ld.volatile.shared.f64") == 1  # in the loop
    assert text.count("st.volatile.shared.f64") == ROWS
    assert ".visible .entry tried(" in text and f".b8 kept_0[{8 * ROWS * WARP}]" in text


def test_call_holds_code_and_places(jaxpr):
    code = code_of("tried", jaxpr, PROGRAMS, kept=1)
    size = jax.ShapeDtypeStruct((PROGRAMS * ROWS * WARP,), float)
    run = call(code, PROGRAMS, [size], 0)
    few = [jax.ShapeDtypeStruct((PROGRAMS * ROWS * WARP,), float)] * 3
    text = jax.jit(run).trace(*few).lower(lowering_platforms=("cuda",)).as_text()
    assert "__gpu$xla.gpu.ptx" in text and f"grid_x = {PROGRAMS}" in text


REFUSED = {
    "sin": lambda a, own: jnp.sin(a[own]),
    "y=-2": lambda a, own: a[own] ** -2,
    "y=0": lambda a, own: jax.lax.integer_pow(a[own], 0),
    "new_dtype=int32": lambda a, own: a[own].astype(jnp.int32).astype(float),
    "float16": lambda a, own: a[own].astype(jnp.float16).astype(float),
    "axis=1": lambda a, own: a[own + pl.program_id(1)],
    "iota": lambda a, own: a[own] + jax.lax.broadcasted_iota(int, (2, WARP), 1).astype(float)[0],
    "scan": lambda a, own: jax.lax.scan(lambda x, _: (x, x), a[own], length=2)[1][0],
}


def body_of(value, kind=float):
    """Jaxpr of a kernel with one array to read and one to write."""

    def kernel(a, b):
        own = jnp.arange(WARP, dtype=jnp.int32)
        b[own] = value(a, own)

    read, result = (jax.ShapeDtypeStruct((WARP,), kind) for kind in (kind, float))
    tried = pl.pallas_call(kernel, out_shape=result, grid=(1, 1), interpret=True)
    (eqn,) = jax.make_jaxpr(tried)(read).eqns
    return eqn.params["jaxpr"]


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_not_known_is_refused(message):
    with pytest.raises(NotImplementedError, match=message):
        written("tried", body_of(REFUSED[message]), 1)


def test_whole_numbers_in_arrays_are_refused():
    with pytest.raises(NotImplementedError, match="int32"):
        written("tried", body_of(lambda a, own: a[own].astype(float), jnp.int32), 1)
