"""Length of a long run, the time and the memory that it will take, told before it begins."""

import os

from experiments.jobs.job import Task

LONG = 200_000  # samples: with less of them a run is at its end in seconds
START = 9.0  # [s] to compile and to draw, whatever the length
# [s] of a sample on one plant: run, score, file and figures. 1.2 million samples of contouring-lq
# on five plants of `bridgeport` took 23.5 s of processor time, 0.12 million took 10.2 s
A_SAMPLE = 2.4e-6
# [bytes] of the program, and of a sample on one plant: 2.1 million samples of contouring-lq on five
# plants of `bridgeport` took 3.7 GB at most, 4.4 million took 6.8 GB
BEGUN, BYTES = 0.8e9, 270


def forecast(job: Task, dt: float, plants: int) -> list[str]:
    """A line about a long run; none about a short one.

    Args:
        job: what is run.
        dt: sample period [s].
        plants: how many plants it is run on.
    """
    if job.samples < LONG:
        return []
    seconds = START + A_SAMPLE * job.samples * plants
    return [
        f"{job.name}: {dt * (job.samples - 1):,.0f} s of motion, {job.samples:,} samples on "
        f"{plants} plants. With contouring-lq this takes about {seconds:.2g} s of processor time; "
        "Ctrl-C ends it."
    ]


def check_memory(job: Task, plants: int, there: float | None = None) -> None:
    """Refuse a run that this computer has no room for.

    Args:
        job: what is run.
        plants: how many plants it is run on.
        there: memory [bytes]; None asks the computer.

    Raises:
        ValueError: it needs more memory than there is.
    """
    needed = BEGUN + BYTES * job.samples * plants
    there = _memory() if there is None else there
    if needed > there:
        raise ValueError(
            f"{job.name}: {job.samples:,} samples on {plants} plants need about "
            f"{1e-9 * needed:.0f} GB of memory, this computer has {1e-9 * there:.0f}: give a "
            "higher feed or a part of the program, or run it piece by piece in Python "
            "(jcontour.simulation.programs.run_program)"
        )


def _memory() -> float:
    """Memory of this computer [bytes]; endless where the system does not tell."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return float("inf")
