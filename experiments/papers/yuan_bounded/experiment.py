"""Yuan 2020, chapter 4: an end effector that stays within a guaranteed error.

The printed data admit no invariant set and no controller; the certificate shows it. With the speed
limit relaxed, a constraint-tightened MPC keeps a third of the thesis's tolerance.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

from experiments.papers.yuan_bounded.claims import claims
from experiments.papers.yuan_bounded.figures import draw
from experiments.papers.yuan_bounded.result import PREVIEWED, UNKNOWN, Result
from experiments.papers.yuan_bounded.runs import (
    LENGTHS,
    PRINTED_CASES,
    QUICK_LENGTHS,
    certificate,
    least_row,
    loop_row,
    observer_radius,
)
from experiments.papers.yuan_bounded.tables import show

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020), chapter 4 "
    "(error-bounded tracking control)"
)
PUBLISHED = ()  # its sets have no numbers in print
SAMPLES, QUICK_SAMPLES = 1500, 450  # of each closed loop


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce yuan-bounded`."""

    quick: bool = False
    """One certificate of three, shorter responses, a third of the samples."""


def run(settings: Settings, folder: Path) -> Result:
    """Compute everything; nothing is written to the folder."""
    cases = PRINTED_CASES[:1] if settings.quick else PRINTED_CASES
    lengths = QUICK_LENGTHS if settings.quick else LENGTHS
    samples = QUICK_SAMPLES if settings.quick else SAMPLES
    found = Result(
        source=SOURCE,
        settings=asdict(settings),
        observer_radius=observer_radius(),
        certificates=tuple(certificate(*case) for case in cases),
        least=tuple(least_row(kind, N) for kind, row in lengths.items() for N in row),
        loops=(
            loop_row(UNKNOWN, lengths[UNKNOWN][-1], samples),
            loop_row(PREVIEWED, lengths[PREVIEWED][0], samples),
        ),
    )
    return replace(found, claims=claims(found))
