"""Eight numbers of a program that is being written: what Python does with them is an instruction.

`Number`s are compared to `Flag`s; a `Whole` counts, and keeps what is known of it apart.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir

WIDTH = 8
LONG, INT, DOUBLE, BIT = ir.IntType(64), ir.IntType(32), ir.DoubleType(), ir.IntType(1)
LANES, FLAGS = ir.VectorType(DOUBLE, WIDTH), ir.VectorType(BIT, WIDTH)
_FUSED = ("contract",)  # a product and a sum become one instruction


class Number:
    """Eight numbers. What is known to be zero or one costs nothing.

    Args:
        builder: of the program.
        value: the instruction that gives them.
    """

    def __init__(self, builder: ir.IRBuilder, value):
        self.builder, self.value = builder, value

    def __add__(self, other):
        if _is(other, 0.0):
            return self
        return self._with("fadd", self, other)

    def __sub__(self, other):
        return self if _is(other, 0.0) else self._with("fsub", self, other)

    def __rsub__(self, other):
        return -self if _is(other, 0.0) else self._with("fsub", other, self)

    def __mul__(self, other):
        if _is(other, 0.0):
            return 0.0
        if _is(other, 1.0):
            return self
        return -self if _is(other, -1.0) else self._with("fmul", self, other)

    def __truediv__(self, other):
        return self if _is(other, 1.0) else self._with("fdiv", self, other)

    def __rtruediv__(self, other):
        return self._with("fdiv", other, self)

    def __neg__(self):
        return Number(self.builder, self.builder.fneg(self.value))

    def __pow__(self, power: int):
        return self if power == 1 else self * self ** (power - 1)

    def __abs__(self):
        return self._called("fabs")

    __radd__, __rmul__ = __add__, __mul__

    def root(self) -> "Number":
        """Square root."""
        return self._called("sqrt")

    def __lt__(self, other):
        return self._compared("<", other)

    def __le__(self, other):
        return self._compared("<=", other)

    def __gt__(self, other):
        return self._compared(">", other)

    def __ge__(self, other):
        return self._compared(">=", other)

    def larger(self, other) -> "Number":
        """The larger number; NaN where one is."""
        return self._extreme(self > other, other)

    def smaller(self, other) -> "Number":
        """The smaller number; NaN where one is."""
        return self._extreme(self < other, other)

    def _extreme(self, further: "Flag", other) -> "Number":
        unknown = self.builder.fcmp_unordered("uno", self.value, self.value)
        return (further | Flag(self.builder, unknown)).chosen(self, other)

    def _compared(self, how: str, other) -> "Flag":
        return Flag(self.builder, self.builder.fcmp_ordered(how, self.value, value(other)))

    def _with(self, operation: str, *numbers) -> "Number":
        instruction: Callable = getattr(self.builder, operation)
        return Number(self.builder, instruction(*map(value, numbers), flags=_FUSED))

    def _called(self, name: str) -> "Number":
        function = known(self.builder, f"llvm.{name}.v{WIDTH}f64", LANES, LANES)
        return Number(self.builder, self.builder.call(function, [self.value]))


class Flag:
    """Whether something holds, of eight numbers."""

    def __init__(self, builder: ir.IRBuilder, value):
        self.builder, self.value = builder, value

    def __and__(self, other):
        if isinstance(other, bool):
            return self if other else False
        return Flag(self.builder, self.builder.and_(self.value, other.value))

    def __or__(self, other):
        return Flag(self.builder, self.builder.or_(self.value, other.value))

    def __invert__(self):
        return Flag(self.builder, self.builder.not_(self.value))

    __rand__ = __and__

    def chosen(self, yes, no) -> Any:
        """`yes` where it holds, `no` elsewhere."""
        if isinstance(yes, float) and yes == no:
            return yes
        return Number(self.builder, self.builder.select(self.value, value(yes), value(no)))

    def anywhere(self):
        """Whether it holds of one of the eight: a bit."""
        every = self.builder.bitcast(self.value, ir.IntType(WIDTH))
        return self.builder.icmp_unsigned("!=", every, ir.IntType(WIDTH)(0))


class Whole:
    """A whole number of the program and a known one added to it."""

    def __init__(self, builder: ir.IRBuilder, value, added: int = 0):
        self.builder, self.value, self.added = builder, value, added

    def __add__(self, other):
        if isinstance(other, int):
            return Whole(self.builder, self.value, self.added + other)
        return Whole(
            self.builder, self.builder.add(self.value, other.value), self.added + other.added
        )

    def __mul__(self, other: int):
        product = self.builder.mul(self.value, LONG(other))
        return Whole(self.builder, product, self.added * other)

    __radd__, __rmul__ = __add__, __mul__


def value(number):
    """Number as LLVM has it, a known one in every lane."""
    if isinstance(number, (int, float)):
        return ir.Constant(LANES, [float(number)] * WIDTH)
    return number.value


def known(builder: ir.IRBuilder, name: str, result, *arguments):
    """Function that is known by name elsewhere."""
    found = builder.module.globals.get(name)
    return found or ir.Function(builder.module, ir.FunctionType(result, arguments), name)


def _is(number, what: float) -> bool:
    return isinstance(number, (int, float)) and number == what
