"""Loops that never end, found where a program comes back to a state that it was in before.

What a program does next follows from its state alone: where the machine is, its modes and offsets,
the parameters, and which line comes next in which subprogram. The same state again means the same
lines for ever. The state is kept at the rounds 1, 2, 4, 8, ... of all loops together, and every
round is compared with the one kept last (Brent, BIT 20, 1980): a period of any length is found.
"""

from copy import deepcopy
from dataclasses import dataclass

from jcontour.geometry.toolpath_rules import ToolpathError


@dataclass
class Repetition:
    """Rounds of loops so far, and the state that was kept.

    Attributes:
        rounds: of all loops.
        kept: state at the last round that is a power of two.
    """

    rounds: int = 0
    kept: tuple = ()

    def check(self, state: tuple) -> None:
        """Compare the state at the begin of a round; it is copied where it is kept.

        Raises:
            ToolpathError: it is the one that was kept.
        """
        self.rounds += 1
        if state == self.kept:
            raise ToolpathError("a loop that does not end: it came back to the same state")
        if self.rounds & (self.rounds - 1) == 0:
            self.kept = deepcopy(state)
