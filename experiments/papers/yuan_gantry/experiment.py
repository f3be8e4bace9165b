"""Yuan 2020, sections 5.1, 5.2, 5.5 and 5.6: a dual-drive gantry and its emulated head.

Its resonances, its twist along a path, its head emulated by a motor bench, and three engines.
Hardly a mass or a stiffness of the machine is printed. Ours solve (5.12) for the two
anti-resonances that are. These two are therefore an input of the model, and everything else
follows from it. A plain follower drives the path; the thesis's set-based controllers are those of
`yuan_contouring_bounded`.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

from experiments.benchmarks.speed.gantry_engines import engine_rates
from experiments.papers.yuan_gantry.claims import claims
from experiments.papers.yuan_gantry.emulation import emulated
from experiments.papers.yuan_gantry.figures import draw
from experiments.papers.yuan_gantry.result import Result
from experiments.papers.yuan_gantry.runs import along_the_path, identified, responses
from experiments.papers.yuan_gantry.tables import show

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020), ch. 5"
)
PUBLISHED = ("antiresonance_hz", "largest_twist_rad")


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce yuan-gantry`."""

    quick: bool = False
    """Time the engines briefly: their rates are rougher."""


def run(settings: Settings, folder: Path) -> Result:
    """Compute everything; nothing is written to the folder."""
    found = Result(
        source=SOURCE,
        settings=asdict(settings),
        responses=responses(),
        path=along_the_path(),
        emulated=emulated(),
        identified=identified(),
        engines=engine_rates(0.2 if settings.quick else 1.0),
    )
    return replace(found, claims=claims(found))
