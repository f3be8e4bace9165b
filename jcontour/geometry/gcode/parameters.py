"""Parameters of a program: #31, #<name> of a subprogram, #<_name> of all, and the machine's own.

LinuxCNC's documentation, "Overview of G-Code Programming", defines which are local and which can be
set.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from jcontour.geometry.toolpath_rules import ToolpathError, shown

LAST = 5601  # number of a parameter
LOCAL = 30  # up to here a subprogram has its own
FIRST_OF_MACHINE = 5001  # from here on the machine says what they are, or nothing does
MOST_NAMES = 100_000  # of named parameters, each some bytes

Said = Callable[[int | str], float | None]  # the machine's value of a parameter, None without one


@dataclass
class Parameters:
    """Values of the parameters, read and set by number or by name.

    >>> parameters = Parameters()
    >>> parameters.set(31, 2.5)
    >>> parameters.value(31), parameters.value(32)
    (2.5, 0.0)

    Attributes:
        said_by_machine: value of a parameter that the machine keeps, such as its position.
    """

    said_by_machine: Said = lambda _: None
    _numbered: dict[int, float] = field(default_factory=dict)
    _common: dict[str, float] = field(default_factory=dict)
    _own: dict[str, float] = field(default_factory=dict)

    def value(self, key: int | str) -> float:
        """Value of #key or #<key>; a number that was never set has 0.

        Raises:
            ToolpathError: a name that was never set, a number that no parameter has.
        """
        if isinstance(key, int):
            _check_number(key)
            said = self.said_by_machine(key) if key >= FIRST_OF_MACHINE else None
            return self._numbered.get(key, 0.0) if said is None else said
        found = self._found(key)
        if found is None:
            raise ToolpathError(f"parameter {shown(f'#<{key}>')} is read before it is set")
        return found

    def exists(self, key: int | str) -> bool:
        """Whether #<key> has been set, or #key may be."""
        if isinstance(key, int):
            return 1 <= key <= LAST
        return self._found(key) is not None

    def set(self, key: int | str, value: float) -> None:
        """Give #key or #<key> a value.

        Raises:
            ToolpathError: one that only the machine sets, a number that no parameter has, more
                names than fit.
        """
        if not math.isfinite(value):
            raise ToolpathError("a parameter is given a value that is not finite")
        if isinstance(key, int):
            _check_number(key)
            if self.said_by_machine(key) is not None:
                raise ToolpathError(f"parameter #{key} is read-only")
            self._numbered[key] = value
            return
        if self.said_by_machine(key) is not None:
            raise ToolpathError(f"parameter {shown(f'#<{key}>')} is read-only")
        values = self._common if key.startswith("_") else self._own
        values[key] = value
        if len(values) > MOST_NAMES:
            raise ToolpathError(f"more than {MOST_NAMES} named parameters")

    def enter(self, arguments: list[float]) -> "Locals":
        """Begin a subprogram: its arguments become #1, #2, ..., the others of its own are 0.

        Return what `leave` restores.
        """
        kept = Locals({n: self._numbered.get(n, 0.0) for n in range(1, LOCAL + 1)}, self._own)
        self._own = {}
        self._numbered.update(dict.fromkeys(kept.numbered, 0.0))
        for number, value in enumerate(arguments, start=1):
            self.set(number, value)
        self._common.pop("_value", None)
        return kept

    def leave(self, kept: "Locals") -> None:
        """End a subprogram: the caller has its own parameters again."""
        self._numbered.update(kept.numbered)
        self._own = kept.named

    def return_value(self, value: float) -> None:
        """Let #<_value> be what a subprogram returned."""
        self._common["_value"] = value

    def _found(self, name: str) -> float | None:
        said = self.said_by_machine(name)
        if said is not None:
            return said
        if name == "_value_returned":
            return float("_value" in self._common)
        if name == "_value":
            return self._common.get(name, 0.0)
        return (self._common if name.startswith("_") else self._own).get(name)


@dataclass(frozen=True)
class Locals:
    """Parameters of a caller while its subprogram runs."""

    numbered: dict[int, float]
    named: dict[str, float]


def _check_number(number: int) -> None:
    if not 1 <= number <= LAST:
        raise ToolpathError(f"parameter #{number}: the number needs to be 1 to {LAST}")
