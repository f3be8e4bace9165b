"""`jcontour simulate PART --list-moves`: what was understood of a program or a drawing."""

from pathlib import Path

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.catalogue.contours import CONTOURS
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.listed_moves import listed_moves
from jcontour.app.jobs.pace import Pace


def command(flags: Simulate) -> int:
    """Print every move of the file."""
    if flags.contour is None or flags.contour in CONTOURS:
        raise ValueError(
            "list-moves: needs a program or a drawing, as in `jcontour simulate part.ngc`"
        )
    for line in listed_moves(Path(flags.contour), Pace.of(flags, machine_named(flags.plant))):
        print(line)
    return 0
