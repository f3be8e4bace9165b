"""How long a run fits into the memory that is free on this computer."""

import psutil

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
        there: free memory [bytes]; None asks the computer.
    """
    there = free_memory() if there is None else there
    return max(int((there - BEGUN) // (BYTES * plants)), 0)


def free_memory() -> float:
    """Memory that programs may still take [bytes], without driving others out."""
    return float(psutil.virtual_memory().available)
