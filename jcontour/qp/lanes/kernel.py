"""What a kernel of the interior point is: its arithmetic, and the numbers that it works on."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Sizes(NamedTuple):
    """Stages N, states n, controls p and limited rows r."""

    N: int
    n: int
    p: int
    r: int

    @property
    def v(self) -> int:
        """Numbers of a stage."""
        return self.n + self.p


class Kernel(NamedTuple):
    """A kernel, and the names of the arrays that it reads and writes.

    Attributes:
        body: called with sizes and the lanes' columns by name.
        problem: arrays of the problem that it reads.
        reads: arrays of the iterations that it reads.
        writes: those that it changes in place.
        beside: arrays of the problem that it keeps in the memory beside its processor, where there
            is room. A small D that is not named is in registers: every stage reads all of it.
        registers: that a lane may take at most.
        softens: whether it is shorter where no limit gives way.
    """

    body: Callable[[Sizes, Any], None]
    problem: str
    reads: str
    writes: str
    beside: str = "A B"
    registers: int = 255
    softens: bool = False
