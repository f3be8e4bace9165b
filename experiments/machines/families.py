"""Uncertainty of a machine, member by member.

Stiffness, masses and the delay of the drives are not known exactly.
"""

from itertools import product
from typing import NamedTuple

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
