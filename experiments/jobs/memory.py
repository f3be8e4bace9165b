"""How long a run this computer's memory holds."""

import os

# [bytes] of the program, and of a sample on one plant: 2.1 million samples of contouring-lq on five
# plants of `bridgeport` took 3.7 GB at most, 4.4 million took 6.8 GB
BEGUN, BYTES = 0.8e9, 270


def needed(samples: int, plants: int) -> float:
    """Memory that a run takes [bytes], about."""
    return BEGUN + BYTES * samples * plants


def room(plants: int, there: float | None = None) -> int:
    """Samples of a run on some plants that the memory holds, none below zero.

    Args:
        plants: how many plants it is run on.
        there: memory [bytes]; None asks the computer.
    """
    there = memory() if there is None else there
    return max(int((there - BEGUN) // (BYTES * plants)), 0)


def memory() -> float:
    """Memory of this computer [bytes]; an exabyte where the system does not tell."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return 1e18
