"""Values in a program: numbers, parameters, [expressions] and functions, as LinuxCNC defines them.

    #31, #<name>, #<_name>              of all, of a subprogram, of all; the machine has its own
    [2.0 / 3 * 1.5 - 5.5 / 11.0]        ** before * / MOD before + - before EQ NE GT GE LT LE
                                        before AND OR XOR; the left one first among equals
    ABS ACOS ASIN ATAN COS EXISTS EXP FIX FUP LN ROUND SIN SQRT TAN, angles in degrees;
    ATAN[y]/[x] has both coordinates

A value is read once and evaluated as often as its line is carried out. LinuxCNC's documentation,
"Overview of G-Code Programming", defines which parameters are local and which can be set.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from jcontour.geometry.toolpath_rules import NUMBER, ToolpathError, shown

LAST = 5601  # number of a parameter
LOCAL = 30  # up to here a subprogram has its own
FIRST_OF_MACHINE = 5001  # from here on the machine says what they are, or nothing does
MOST_NAMES = 100_000  # of named parameters, each some bytes

EQUAL = 1e-6  # difference of two values that compare EQ
NEAR_WHOLE = 1e-4  # distance from a whole number that still counts as one
DEEPEST = 50  # brackets within brackets
MOST_OPERATIONS = 200  # of a line; a control reads lines of 256 characters
WORD_NUMBER = re.compile(NUMBER)
UNSIGNED = re.compile(r"[0-9]+(?:\.[0-9]*)?|\.[0-9]+")
OPERATOR = re.compile(r"\*\*|[*/+-]|MOD|EQ|NE|GT|GE|LT|LE|AND|OR|XOR", re.IGNORECASE)
FUNCTION = re.compile(r"[A-Za-z]+")
NAME = re.compile(r"<([^<>]*)>")
NO_VALUE: dict[type, str] = {
    ZeroDivisionError: "a division by zero",
    OverflowError: "a result is too large",
    ValueError: "a function has no value for this argument",
}
FUNCTIONS: dict[str, Callable[[float], float]] = {
    "ABS": abs,
    "ACOS": lambda x: math.degrees(math.acos(x)),
    "ASIN": lambda x: math.degrees(math.asin(x)),
    "COS": lambda x: math.cos(math.radians(x)),
    "EXP": math.exp,
    "FIX": lambda x: float(math.floor(x)),
    "FUP": lambda x: float(math.ceil(x)),
    "LN": math.log,
    "ROUND": lambda x: float(math.trunc(x + math.copysign(0.5, x))),
    "SIN": lambda x: math.sin(math.radians(x)),
    "SQRT": math.sqrt,
    "TAN": lambda x: math.tan(math.radians(x)),
}


@dataclass
class Parameters:
    """Values of the parameters, read and set by number or by name.

    >>> parameters = Parameters()
    >>> parameters.set(31, 2.5)
    >>> parameters.value(31), parameters.value(32)
    (2.5, 0.0)

    Attributes:
        machine: value of a parameter that the machine keeps, such as its position; None for others.
        numbered: values of #1, #2, ...
        common: values of #<_name>.
        own: values of #<name>, of the subprogram under way.
    """

    machine: Callable[[int | str], float | None] = lambda _: None
    numbered: dict[int, float] = field(default_factory=dict)
    common: dict[str, float] = field(default_factory=dict)
    own: dict[str, float] = field(default_factory=dict)

    def value(self, key: int | str) -> float:
        """Value of #key or #<key>; a number that was never set has 0."""
        if isinstance(key, int):
            _check_number(key)
            kept = self.machine(key) if key >= FIRST_OF_MACHINE else None
            return self.numbered.get(key, 0.0) if kept is None else kept
        value = self._named(key)
        if value is None:
            raise ToolpathError(f"parameter {shown(f'#<{key}>')} is read before it is set")
        return value

    def exists(self, key: int | str) -> bool:
        """Whether #<key> has been set, or #key may be."""
        return 1 <= key <= LAST if isinstance(key, int) else self._named(key) is not None

    def set(self, key: int | str, value: float) -> None:
        """Give #key or #<key> a value."""
        if not math.isfinite(value):
            raise ToolpathError("a parameter is given a value that is not finite")
        if isinstance(key, int):
            _check_number(key)
        if self.machine(key) is not None:
            name = f"#{key}" if isinstance(key, int) else shown(f"#<{key}>")
            raise ToolpathError(f"parameter {name} is read-only")
        if isinstance(key, int):
            self.numbered[key] = value
            return
        values = self.common if key.startswith("_") else self.own
        values[key] = value
        if len(values) > MOST_NAMES:
            raise ToolpathError(f"more than {MOST_NAMES} named parameters")

    def enter(self, arguments: list[float]) -> "Locals":
        """Begin a subprogram: its arguments become #1, #2, ..., the others of its own are 0.

        Return what `leave` restores.
        """
        kept = {n: self.numbered.get(n, 0.0) for n in range(1, LOCAL + 1)}, self.own
        self.own = {}
        self.numbered.update(dict.fromkeys(kept[0], 0.0))
        for number, value in enumerate(arguments, start=1):
            self.set(number, value)
        self.common.pop("_value", None)
        return kept

    def leave(self, kept: "Locals") -> None:
        """End a subprogram: the caller has its own parameters again."""
        self.numbered.update(kept[0])
        self.own = kept[1]

    def _named(self, name: str) -> float | None:
        kept = self.machine(name)
        if kept is not None:
            return kept
        if name == "_value_returned":
            return float("_value" in self.common)
        if name == "_value":
            return self.common.get(name, 0.0)
        return (self.common if name.startswith("_") else self.own).get(name)


Locals = tuple[dict[int, float], dict[str, float]]  # of a caller, by number and by name


def _check_number(number: int) -> None:
    if not 1 <= number <= LAST:
        raise ToolpathError(f"parameter #{number}: the number needs to be 1 to {LAST}")


Expression = Callable[[Parameters], float]


def _modulo(a: float, b: float) -> float:
    rest = math.fmod(a, b)
    return rest + abs(b) if rest < 0 else rest


def _power(a: float, b: float) -> float:
    if a < 0 and b % 1:
        raise ToolpathError("a negative number to a power that is not whole")
    return a**b


OPERATIONS: dict[str, tuple[int, Callable[[float, float], float]]] = {
    "**": (5, _power),
    "*": (4, lambda a, b: a * b),
    "/": (4, lambda a, b: a / b),
    "MOD": (4, _modulo),
    "+": (3, lambda a, b: a + b),
    "-": (3, lambda a, b: a - b),
    "EQ": (2, lambda a, b: float(abs(a - b) < EQUAL)),
    "NE": (2, lambda a, b: float(abs(a - b) >= EQUAL)),
    "GT": (2, lambda a, b: float(a > b)),
    "GE": (2, lambda a, b: float(a >= b or abs(a - b) < EQUAL)),
    "LT": (2, lambda a, b: float(a < b)),
    "LE": (2, lambda a, b: float(a <= b or abs(a - b) < EQUAL)),
    "AND": (1, lambda a, b: float(a != 0 and b != 0)),
    "OR": (1, lambda a, b: float(a != 0 or b != 0)),
    "XOR": (1, lambda a, b: float((a != 0) != (b != 0))),
}


@dataclass
class Cursor:
    """Place in a line without white space, up to which it has been read."""

    text: str
    at: int = 0
    depth: int = 0
    operations: int = 0

    @property
    def rest(self) -> str:
        """What is still to be read."""
        return self.text[self.at :]

    @property
    def ended(self) -> bool:
        """Whether all is read."""
        return self.at >= len(self.text)

    def take(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """Read what the pattern matches here, if it does."""
        match = pattern.match(self.text, self.at)
        if match:
            self.at = match.end()
        return match

    def starts(self, character: str) -> bool:
        """Whether this character is next."""
        return self.text.startswith(character, self.at)

    def expect(self, character: str) -> None:
        """Read a character that has to be here."""
        if not self.starts(character):
            raise ToolpathError(f"needs {character!r} before {shown(self.rest)}")
        self.at += 1


def evaluated(expression: Expression, parameters: Parameters) -> float:
    """Value of an expression."""
    try:
        value = expression(parameters)
    except ToolpathError:
        raise
    except (ZeroDivisionError, OverflowError, ValueError) as error:
        raise ToolpathError(NO_VALUE[type(error)]) from None
    if not math.isfinite(value):
        raise ToolpathError("a result is not finite")
    return value


def read_value(cursor: Cursor) -> Expression:
    """Read a number, a parameter, a [bracket] or a function.

    >>> evaluated(read_value(Cursor("[2+3*4**2]")), Parameters())
    50.0
    """
    number = cursor.take(WORD_NUMBER)
    if number:
        constant = float(number[0])
        return lambda parameters: constant
    if cursor.starts("["):
        return read_bracket(cursor)
    if cursor.starts("#"):
        key = read_key(cursor)
        return lambda parameters: parameters.value(key(parameters))
    for sign, factor in (("+", 1.0), ("-", -1.0)):
        if cursor.starts(sign):
            cursor.at += 1
            value = _deeper(cursor, read_value)
            return lambda parameters: factor * value(parameters)
    before, name = cursor.at, cursor.take(FUNCTION)
    called = name[0].upper() if name else ""
    if called == "ATAN":
        y = read_bracket(cursor)
        cursor.expect("/")
        x = read_bracket(cursor)
        return lambda parameters: math.degrees(math.atan2(y(parameters), x(parameters)))
    if called == "EXISTS":
        cursor.expect("[")
        key = read_key(cursor)
        cursor.expect("]")
        return lambda parameters: float(parameters.exists(key(parameters)))
    if called not in FUNCTIONS or not cursor.starts("["):
        cursor.at = before
        raise ToolpathError(f"needs a number before {shown(cursor.rest)}")
    function, argument = FUNCTIONS[called], read_bracket(cursor)
    return lambda parameters: function(argument(parameters))


def read_bracket(cursor: Cursor) -> Expression:
    """Read an expression in brackets."""
    cursor.expect("[")
    value = _deeper(cursor, lambda cursor: _read_operations(cursor, 0))
    cursor.expect("]")
    return value


def read_key(cursor: Cursor) -> Callable[[Parameters], int | str]:
    """Read what parameter is meant: a number after #, also computed, or a name in <>."""
    cursor.expect("#")
    name = cursor.take(NAME)
    if name:
        key = name[1].lower()
        if not key:
            raise ToolpathError("a parameter without a name")
        return lambda parameters: key
    digits = cursor.take(UNSIGNED)
    if digits:
        number = whole(float(digits[0]), "the number of a parameter")
        return lambda parameters: number
    value = _deeper(cursor, read_value)
    return lambda parameters: whole(evaluated(value, parameters), "the number of a parameter")


def whole(value: float, meaning: str) -> int:
    """Whole number that a value means."""
    nearest = round(value) if math.isfinite(value) else 0
    if not abs(value - nearest) < NEAR_WHOLE:
        raise ToolpathError(f"{meaning} needs to be whole, received {value:g}")
    return nearest


def _deeper(cursor: Cursor, read: Callable[[Cursor], Expression]) -> Expression:
    cursor.depth += 1
    if cursor.depth > DEEPEST:
        raise ToolpathError(f"an expression is nested more than {DEEPEST} times")
    value = read(cursor)
    cursor.depth -= 1
    return value


def _read_operations(cursor: Cursor, least: int) -> Expression:
    """Read values joined by operators that bind more than `least`."""
    left = read_value(cursor)
    while True:
        before = cursor.at
        sign = cursor.take(OPERATOR)
        if sign is None:
            return left
        binding, operation = OPERATIONS[sign[0].upper()]
        if binding <= least:
            cursor.at = before
            return left
        cursor.operations += 1
        if cursor.operations > MOST_OPERATIONS:
            raise ToolpathError(f"more than {MOST_OPERATIONS} operations in a line")
        right = _deeper(cursor, lambda cursor, least=binding: _read_operations(cursor, least))
        left = _operated(operation, left, right)


def _operated(
    operation: Callable[[float, float], float], left: Expression, right: Expression
) -> Expression:
    return lambda parameters: operation(left(parameters), right(parameters))
