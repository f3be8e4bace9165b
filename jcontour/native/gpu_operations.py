"""Operations of a Pallas kernel written for a GPU, one after the other, as LLVM's.

A vector over the lanes is one number of a thread. Whole numbers keep what is known of them apart,
so that a place in an array costs no arithmetic.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
from llvmlite import ir

LONG, _INT, _BIT = ir.IntType(64), ir.IntType(32), ir.IntType(1)
WARP = 32


class Whole(NamedTuple):
    """A whole number: one that the program finds, None for zero, and a known one added to it."""

    value: Any
    known: int = 0


class Array(NamedTuple):
    """Address of an array, and the kind of memory that it is in."""

    address: Any
    memory: str


class Writer:
    """Writes the operations of a jaxpr: a value is a `Whole`, or a number of LLVM."""

    def __init__(self, builder: ir.IRBuilder):
        self.builder = builder
        self.found: dict = {}  # sums and products of whole numbers, and addresses

    def run(self, jaxpr, arguments: Sequence, constants: Sequence = ()) -> list:
        """Values of a jaxpr's results."""
        pairs = (*zip(jaxpr.constvars, constants, strict=True),)
        known = dict([*pairs, *zip(jaxpr.invars, arguments, strict=True)])

        def read(atom):
            return self._literal(atom) if hasattr(atom, "val") else known[atom]

        for eqn in jaxpr.eqns:
            name = eqn.primitive.name.removesuffix("_p")
            results = self._written(name, eqn, [read(atom) for atom in eqn.invars])
            known |= zip(eqn.outvars, results, strict=True)
        return [read(atom) for atom in jaxpr.outvars]

    def _written(self, name: str, eqn, values: list) -> Sequence:
        if name in _SAME:
            return values[:1]
        if name in _INNER:
            return self._inner(eqn.params.get("jaxpr") or eqn.params["call_jaxpr"], values)
        if hasattr(self, f"_{name}"):
            return getattr(self, f"_{name}")(eqn, *values)
        whole = all(isinstance(value, Whole) for value in values)
        table = _WHOLE if whole else _BITS if _are_bits(values) else _NUMBERS
        if name not in table:
            raise NotImplementedError(f"{name} of {[str(atom.aval) for atom in eqn.invars]}")
        return [table[name](self, *values)]

    def _inner(self, jaxpr, arguments: Sequence) -> list:
        """Values of the results of a jaxpr inside, closed or with no constants of its own."""
        return self.run(getattr(jaxpr, "jaxpr", jaxpr), arguments, getattr(jaxpr, "consts", ()))

    def _literal(self, atom):
        kind, value = atom.aval.dtype, atom.val
        if jnp.issubdtype(kind, jnp.integer):
            return Whole(None, int(value))
        if kind == jnp.bool_:
            return _BIT(int(value))
        return _type(kind)(float(value))

    def materialised(self, whole: Whole):
        """Whole number as LLVM has it."""
        if whole.value is None:
            return LONG(whole.known)
        return self._once("add", whole.value, whole.known) if whole.known else whole.value

    def _once(self, operation: str, value, number: int):
        """Sum or product with a known number, written once in every block that sees it."""
        place = operation, id(value), number
        if place not in self.found:
            result = getattr(self.builder, operation)(value, LONG(number))
            self.found[place] = result, value  # which keeps its id
        return self.found[place][0]

    def _inside(self, write: Callable):
        """What is written in a block of its own; nothing that is found there is known behind."""
        before = dict(self.found)
        result = write()
        self.found = before
        return result

    def _address(self, array: Array, place: Whole, size: int):
        """Address of a number but for the known part, and that part, in bytes."""
        if place.value is None:
            return array.address, place.known * size
        key = "address", id(array.address), id(place.value)
        if key not in self.found:
            bytes_ = self._once("mul", place.value, size)
            self.found[key] = self.builder.add(array.address, bytes_), place.value
        return self.found[key][0], place.known * size

    def _get(self, eqn, array, place):
        names, kind, size = register(eqn.outvars[0].aval.dtype)
        address, known = self._address(array, place, size)
        function = ir.FunctionType(kind, [LONG])
        text = f"ld.{array.memory}.{names[0]} $0, [$1+{known}];"
        asm = ir.InlineAsm(function, text, f"={names[1]},l", side_effect=True)
        return [self.builder.call(asm, [address])]

    def _swap(self, eqn, array, number, place):
        names, kind, size = register(eqn.invars[1].aval.dtype)
        address, known = self._address(array, place, size)
        function = ir.FunctionType(ir.VoidType(), [LONG, kind])
        text = f"st.{array.memory}.{names[0]} [$0+{known}], $1;"
        asm = ir.InlineAsm(function, text, f"l,{names[1]}", side_effect=True)
        self.builder.call(asm, [address, number])
        return [None]

    def _program_id(self, eqn):
        _refuse(eqn, eqn.params["axis"] != 0)
        return [Whole(special(self.builder, "ctaid.x"))]

    def _iota(self, eqn):
        params = eqn.params
        lanes = params["shape"] == (WARP,) and jnp.issubdtype(params["dtype"], jnp.integer)
        _refuse(eqn, not lanes)
        return [Whole(special(self.builder, "tid.x"))]

    def _reduce_or(self, eqn, flag):
        name = "llvm.nvvm.vote.any.sync"
        function = _intrinsic(self.builder, name, _BIT, [_INT, _BIT])
        return [self.builder.call(function, [_INT(-1), flag])]

    def _convert_element_type(self, eqn, value):
        wanted, builder = eqn.params["new_dtype"], self.builder
        if jnp.issubdtype(wanted, jnp.integer):
            if isinstance(value, Whole):
                return [value]
            _refuse(eqn, value.type != _BIT)
            return [Whole(builder.zext(value, LONG))]
        kind = _type(wanted)
        if isinstance(value, Whole):
            return [builder.sitofp(self.materialised(value), kind)]
        if value.type == _BIT:
            return [builder.uitofp(value, kind)]
        if value.type == kind:
            return [value]
        change = builder.fptrunc if kind == ir.FloatType() else builder.fpext
        return [change(value, kind)]

    def _select_n(self, eqn, flag, no, yes):
        if isinstance(no, Whole):
            pair = self.materialised(yes), self.materialised(no)
            return [Whole(self.builder.select(flag, *pair))]
        return [self.builder.select(flag, yes, no)]

    def _integer_pow(self, eqn, value):
        result = value
        _refuse(eqn, eqn.params["y"] < 1)
        for _ in range(eqn.params["y"] - 1):
            result = self.builder.fmul(result, value)
        return [result]

    def _elementwise_inline_asm(self, eqn, a, b, c):
        assert eqn.params["asm"].startswith("fma.rn")
        function = _intrinsic(self.builder, f"llvm.fma.{_suffix(a)}", a.type, [a.type] * 3)
        return [self.builder.call(function, [a, b, c])]

    def _scan(self, eqn, *values):
        body = eqn.params["jaxpr"]
        inner = getattr(body, "jaxpr", body)
        outside, inside = ((*one.invars, *one.outvars) for one in (eqn, inner))
        # arrays of which every pass reads or writes its own part have an axis more outside
        shapes = ([atom.aval.shape for atom in atoms] for atoms in (outside, inside))
        _refuse(eqn, next(shapes) != next(shapes))
        first = len(values) - len(eqn.outvars)  # behind the constants
        if eqn.params["length"] == 0:
            return values[first:]
        write = partial(self._inner, body)
        return self._loop(eqn.params["length"], write, values[:first], values[first:])

    def _loop(self, length: int, body: Callable, constants: Sequence, begun: Sequence) -> list:
        builder, before = self.builder, self.builder.block
        inside, behind = (builder.function.append_basic_block() for _ in range(2))
        begun = [self.materialised(v) if isinstance(v, Whole) else v for v in begun]
        builder.branch(inside)
        builder.position_at_end(inside)
        left, carried = builder.phi(LONG), [builder.phi(value.type) for value in begun]
        left.add_incoming(LONG(length), before)
        for phi, value in zip(carried, begun, strict=True):
            phi.add_incoming(value, before)

        def write():
            numbers = [Whole(phi) if phi.type == LONG else phi for phi in carried]
            found = body([*constants, *numbers])
            return [self.materialised(v) if isinstance(v, Whole) else v for v in found]

        found = self._inside(write)
        fewer = builder.sub(left, LONG(1))
        left.add_incoming(fewer, builder.block)
        for phi, value in zip(carried, found, strict=True):
            phi.add_incoming(value, builder.block)
        builder.cbranch(builder.icmp_signed(">", fewer, LONG(0)), inside, behind)
        builder.position_at_end(behind)
        return [Whole(value) if value.type == LONG else value for value in found]

    def _cond(self, eqn, index, *values):
        no, yes = eqn.params["branches"]
        assert not eqn.outvars
        flag = self.builder.icmp_signed("!=", self.materialised(index), LONG(0))
        with self.builder.if_else(flag) as (then, otherwise):
            for block, branch in ((then, yes), (otherwise, no)):
                with block:
                    self._inside(partial(self._inner, branch, values))
        return []

    def number(self, operation: str, *values):
        """Operation on numbers; a product and a sum may become one instruction."""
        return getattr(self.builder, operation)(*values, flags=("contract",))

    def compared(self, how: str, a, b):
        """Comparison of numbers; with NaN only `!=` holds."""
        compare = self.builder.fcmp_unordered if how == "!=" else self.builder.fcmp_ordered
        return compare(how, a, b)

    def larger(self, how: str, a, b):
        """The larger number or the smaller one; NaN where one is."""
        first = self.builder.fcmp_unordered("uno", a, a)
        return self.builder.select(self.builder.or_(self.compared(how, a, b), first), a, b)

    def called(self, name: str, value):
        """Function of LLVM of a number."""
        name = f"llvm.{name}.{_suffix(value)}"
        return self.builder.call(_intrinsic(self.builder, name, value.type, [value.type]), [value])

    def finite(self, value):
        """Whether a number is."""
        return self.compared("<", self.called("fabs", value), value.type(float("inf")))

    def sum_of(self, sign: int, a: Whole, b: Whole) -> Whole:
        """Sum or difference of whole numbers."""
        known = a.known + sign * b.known
        if b.value is None:
            return Whole(a.value, known)
        if a.value is None and sign > 0:
            return Whole(b.value, known)
        operation = self.builder.add if sign > 0 else self.builder.sub
        first = LONG(0) if a.value is None else a.value
        place = "sum", sign, id(first), id(b.value)
        if place not in self.found:
            self.found[place] = operation(first, b.value), (first, b.value)
        return Whole(self.found[place][0], known)

    def times(self, a: Whole, b: Whole) -> Whole:
        """Product of whole numbers."""
        if a.value is None:
            a, b = b, a
        if b.value is None:
            value = None if a.value is None else self._once("mul", a.value, b.known)
            return Whole(value, a.known * b.known)
        return self.whole("mul", a, b)

    def whole(self, operation: str, a: Whole, b: Whole) -> Whole:
        """Operation on whole numbers."""
        values = self.materialised(a), self.materialised(b)
        return Whole(getattr(self.builder, operation)(*values))

    def whole_compared(self, how: str, a: Whole, b: Whole):
        """Comparison of whole numbers."""
        return self.builder.icmp_signed(how, self.materialised(a), self.materialised(b))

    def smaller_whole(self, how: str, a: Whole, b: Whole) -> Whole:
        """The smaller whole number or the larger one."""
        values = self.materialised(a), self.materialised(b)
        flag = self.builder.icmp_signed(how, *values)
        return Whole(self.builder.select(flag, *values))

    def sign(self, a: Whole) -> Whole:
        """Whether a whole number is above zero, less whether it is below."""
        above, below = (self.whole_compared(how, a, Whole(None)) for how in "><")
        above, below = (self.builder.zext(flag, LONG) for flag in (above, below))
        return Whole(self.builder.sub(above, below))

    def inverse_root(self, value):
        """Inverse of a square root, both rounded."""
        return self.number("fdiv", value.type(1.0), self.called("sqrt", value))

    def negative(self, value):
        """Negative number."""
        return self.builder.fneg(value)

    def bit(self, operation: str, *values):
        """Operation on flags."""
        return getattr(self.builder, operation)(*values)


def _made(method: Callable, *first) -> Callable:
    return lambda writer, *values: method(writer, *first, *values)


_COMPARISONS = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}
_SAME = {"broadcast_in_dim", "reshape", "squeeze", "copy", "stop_gradient"}
_INNER = {"jit", "pjit", "closed_call", "custom_jvp_call"}
_NUMBERS = {
    "add": _made(Writer.number, "fadd"),
    "sub": _made(Writer.number, "fsub"),
    "mul": _made(Writer.number, "fmul"),
    "div": _made(Writer.number, "fdiv"),
    "add_any": _made(Writer.number, "fadd"),
    "neg": Writer.negative,
    "square": lambda writer, value: writer.number("fmul", value, value),
    "abs": _made(Writer.called, "fabs"),
    "sqrt": _made(Writer.called, "sqrt"),
    "rsqrt": Writer.inverse_root,
    "max": _made(Writer.larger, ">"),
    "min": _made(Writer.larger, "<"),
    "is_finite": Writer.finite,
} | {name: _made(Writer.compared, how) for name, how in _COMPARISONS.items()}
_WHOLE = {
    "add": _made(Writer.sum_of, 1),
    "sub": _made(Writer.sum_of, -1),
    "mul": Writer.times,
    "div": _made(Writer.whole, "sdiv"),
    "rem": _made(Writer.whole, "srem"),
    "sign": Writer.sign,
    "min": _made(Writer.smaller_whole, "<"),
    "max": _made(Writer.smaller_whole, ">"),
} | {name: _made(Writer.whole_compared, how) for name, how in _COMPARISONS.items()}
_BITS = {
    "and": _made(Writer.bit, "and_"),
    "or": _made(Writer.bit, "or_"),
    "not": _made(Writer.bit, "not_"),
    "ne": _made(Writer.bit, "xor"),
}


def _are_bits(values: Sequence) -> bool:
    return all(not isinstance(value, Whole) and value.type == _BIT for value in values)


def _refuse(eqn, unknown: bool) -> None:
    if unknown:
        raise NotImplementedError(str(eqn))


def _type(kind):
    known = {"float64": ir.DoubleType(), "float32": ir.FloatType()}
    name = jnp.dtype(kind).name
    if name not in known:
        raise NotImplementedError(f"numbers of type {name}")
    return known[name]


def register(kind) -> tuple[tuple[str, str], Any, int]:
    """Names of a number's type for the machine, its type, and its bytes."""
    size = jnp.dtype(kind).itemsize
    return (("f64", "d") if size == 8 else ("f32", "f")), _type(kind), size


def special(builder: ir.IRBuilder, name: str):
    """Number of the program or of the lane."""
    function = _intrinsic(builder, f"llvm.nvvm.read.ptx.sreg.{name}", _INT, [])
    return builder.zext(builder.call(function, []), LONG)


def _suffix(value) -> str:
    return "f64" if value.type == ir.DoubleType() else "f32"


def _intrinsic(builder: ir.IRBuilder, name: str, result, arguments: Sequence):
    known = builder.module.globals.get(name)
    kind = ir.FunctionType(result, arguments)
    return known or ir.Function(builder.module, kind, name)
