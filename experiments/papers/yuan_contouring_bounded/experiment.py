"""Yuan 2020, sections 5.3 to 5.5: a gantry's contour error kept within a proven bound.

The two contouring controllers of the thesis, by bounded tracking errors (CEBC-1) and by the contour
error itself (CEBC-2), along Fig. 5.11. As printed they constrain the nominal prediction only. Here
every limit is tightened by what disturbances can do, over all switches of the model.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

from experiments.papers.yuan_contouring_bounded.claims import claims
from experiments.papers.yuan_contouring_bounded.figures import draw
from experiments.papers.yuan_contouring_bounded.result import Result
from experiments.papers.yuan_contouring_bounded.runs import QUICK, ROWS, loop_row, polygons
from experiments.papers.yuan_contouring_bounded.tables import show

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020), sections 5.3 to 5.5"
)
PUBLISHED = ()  # of the same machine: its masses, bounds and disturbances are not printed
QUICK_STEPS = 700  # of 3,384: the first line and a tenth of the circle


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce yuan-contouring-bounded`."""

    quick: bool = False
    """Four runs of ten, along the first fifth of the path."""


def run(settings: Settings, folder: Path) -> Result:
    """Compute everything; nothing is written to the folder."""
    rows = [ROWS[i] for i in QUICK] if settings.quick else ROWS
    steps = QUICK_STEPS if settings.quick else None
    found = Result(
        source=SOURCE,
        settings=asdict(settings),
        polygons=polygons(),
        loops=tuple(loop_row(*row, steps) for row in rows),
    )
    return replace(found, claims=claims(found))
