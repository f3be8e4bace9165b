"""Yuan 2020, sections 5.1, 5.2, 5.5 and 5.6: a dual-drive gantry and its emulated head.

Its resonances, its twist along a path, its head emulated by a motor bench, and three engines.
Hardly a mass or a stiffness of the machine is printed. Ours solve (5.12) for the two
anti-resonances that are. These two are therefore an input of the model, and everything else
follows from it. A plain follower drives the path; the thesis's set-based controllers are those of
`yuan_contouring_bounded`.
"""

from dataclasses import dataclass

from experiments.benchmarks.speed.gantry_engines import engine_differences
from experiments.papers.yuan_gantry.emulation import Emulated, emulated
from experiments.papers.yuan_gantry.runs import (
    Identified,
    PathRun,
    Response,
    along_the_path,
    identified,
    responses,
)

SOURCE = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020), ch. 5"
)


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce yuan-gantry`."""

    quick: bool = False
    """The same: the whole takes seconds."""


@dataclass(frozen=True)
class Result:
    """Resonances, the path, the emulated head, the identified machine, and three engines."""

    responses: tuple[Response, ...]
    path: PathRun
    emulated: Emulated
    identified: tuple[Identified, ...]
    engines: dict[str, float]  # largest difference to our model in a step, relative

    def response(self, head: float, coupling: bool) -> Response:
        """Response for a position of the head [m]."""
        wanted = (head, coupling)
        return next(row for row in self.responses if (row.head_m, row.coupling) == wanted)


def run(settings: Settings) -> Result:
    """Compute everything."""
    return Result(responses(), along_the_path(), emulated(), identified(), engine_differences())
