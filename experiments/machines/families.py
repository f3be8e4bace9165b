"""Uncertainty of a machine, member by member.

Stiffness, masses and the delay of the drives are not known exactly.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from experiments.machines.machine import Fed, Machine

LATE = 1  # most samples of delay that a model does not know: a drive's bus


class Member(NamedTuple):
    """Name, factors on stiffness and on masses, samples that the control is late."""

    name: str
    stiffness: float
    mass: float
    late: int


def members(stiffness: float, mass: float) -> list[Member]:
    """Nominal machine, corners of these relative uncertainties, and the late machine."""
    corners = [(1 + a * stiffness, 1 + b * mass) for a, b in product((1, -1), repeat=2)]
    off = [Member(f"stiffness x {k:g}, masses x {m:g}", k, m, 0) for k, m in corners]
    return [Member("nominal", 1.0, 1.0, 0), *off, Member(f"{LATE} sample late", 1.0, 1.0, LATE)]


@dataclass(frozen=True)
class MotorMeasuredMachine(Machine):
    """Machine whose motors are measured; stiffness, masses and delay are uncertain."""

    @property
    @abc.abstractmethod
    def members(self) -> Sequence[Member]:
        """Members of the family, the nominal one first."""

    @property
    def family_names(self) -> list[str]:
        """Names of the members."""
        return [member.name for member in self.members]

    @property
    def unknown_delay(self) -> int:
        """Delay of a drive's bus."""
        return LATE

    def check_fed(self, fed: Fed) -> None:
        """Raise ValueError where a controller asks for the whole state."""
        if fed == "state":
            raise ValueError(f"controller: {self.name} measures its motors, not its whole state")
