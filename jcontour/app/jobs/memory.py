"""How long a run fits into the memory that is free on this computer."""

import numpy as np
import psutil

from jcontour.app.machines.machine import Machine

# [bytes] of the program, and of a sample on one plant: 2.1 million samples of contouring-lq on five
# plants of `bridgeport` took 3.7 GB at most, 4.4 million took 6.8 GB
BEGUN, BYTES = 0.8e9, 270


class TooLongError(ValueError):
    """A motion whose samples do not fit into the free memory.

    Attributes:
        piece: number of the piece that takes longest.
    """

    def __init__(
        self, piece: int, seconds: float, dwells: float, z_alone: float, dt: float, most: int
    ):
        self.piece = piece
        of_them = f", {dwells:.3g} s of it in dwells (P of G4 is in seconds)" if dwells else ""
        of_them += f", {z_alone:.3g} s of it while Z moves alone" if z_alone else ""
        super().__init__(
            f"the program takes {seconds:.3g} s at least, longest here{of_them}; that is more than "
            f"the {most:,} samples of {dt:g} s that fit into the free memory: give a higher "
            f"feed{', shorter dwells' if dwells else ''} or a part of the program"
        )


def most_samples(plants: int) -> int:
    """Samples of a run on some plants that the free memory [bytes] holds, none below zero."""
    return max(int((free_memory() - BEGUN) // (BYTES * plants)), 0)


def free_memory() -> float:
    """Memory that programs may still take [bytes], without driving others out."""
    return float(psutil.virtual_memory().available)


def check_duration(
    moving: np.ndarray, dwelling: np.ndarray, z_alone: np.ndarray, machine: Machine
) -> None:
    """Refuse what takes so long [s] that its samples do not fit in memory."""
    lasting = moving + dwelling + z_alone
    whole, *resting = (float(np.sum(part)) for part in (lasting, dwelling, z_alone))
    dt, most = machine.model.dt, most_samples(len(machine.family_names))
    if whole / dt > most:
        raise TooLongError(int(np.argmax(lasting)), whole, *resting, dt, most)


def check_memory(name: str, samples: int, plants: int) -> None:
    """Refuse a run that does not fit into the free memory [bytes]."""
    there, takes = free_memory(), BEGUN + BYTES * samples * plants
    if takes > there:
        raise ValueError(
            f"{name}: {samples:,} samples on {plants} plants need about {1e-9 * takes:.0f} GB of "
            f"memory, {1e-9 * there:.0f} are free: give a higher feed or a part of the program"
        )
