"""Length of a long run, the time and the memory that it will take, printed before it begins."""

from jcontour.app.jobs.job import Task
from jcontour.app.jobs.memory import free_memory, needed

LONG = 200_000  # samples: with less of them a run is at its end in seconds
START = 9.0  # [s] to compile and to draw, whatever the length
# [s] of a sample on one plant: run, score, file and figures. 1.2 million samples of contouring-lq
# on five plants of `bridgeport` took 23.5 s of processor time, 0.12 million took 10.2 s
A_SAMPLE = 2.4e-6


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
        f"{_length(job, dt, plants)}. With contouring-lq this takes about {_seconds(seconds)} of "
        "processor time; Ctrl-C ends it."
    ]


def outline(job: Task, dt: float, plants: int, doing: str) -> str:
    """A line about a run in steps, before it begins.

    Args:
        job: what is run.
        dt: sample period [s].
        plants: how many plants it is run on.
        doing: the steps, in words.
    """
    return f"{_length(job, dt, plants)}: {doing}; Ctrl-C ends it."


def _length(job: Task, dt: float, plants: int) -> str:
    """How long a run is."""
    lasting = _seconds(dt * (job.samples - 1))
    return f"{job.name}: {lasting} of motion, {job.samples:,} samples on {plants} plants"


def _seconds(lasting: float) -> str:
    """A time in two digits, or in whole seconds."""
    return f"{lasting:,.0f} s" if lasting >= 10 else f"{lasting:.2g} s"


def check_memory(job: Task, plants: int, there: float | None = None) -> None:
    """Refuse a run that this computer has no room for.

    Args:
        job: what is run.
        plants: how many plants it is run on.
        there: free memory [bytes]; None asks the computer.
    """
    there = free_memory() if there is None else there
    takes = needed(job.samples, plants)
    if takes > there:
        raise ValueError(
            f"{job.name}: {job.samples:,} samples on {plants} plants need about "
            f"{1e-9 * takes:.0f} GB of memory, {1e-9 * there:.0f} are free: give a "
            "higher feed or a part of the program"
        )
