"""`jcontour simulate PART --list-moves`: what was understood of a program or a drawing."""

import json
from importlib import import_module
from pathlib import Path

from jcontour.app.catalogue.entries import CONTOURS
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.listed_moves import listed_moves

USUAL = ("bridgeport", "xy-table", "emps")  # X and Y


def command(flags: Simulate) -> int:
    """Print every move of the file."""
    if flags.contour is None or flags.contour in CONTOURS:
        raise ValueError(
            "list-moves: needs a program or a drawing, as in `jcontour simulate part.ngc`"
        )
    for line in listed_moves(Path(flags.contour), axes_of(flags.plant), flags):
        print(line)
    return 0


def axes_of(plant: str) -> int:
    """Number of axes of a machine; its model, which takes a second to load, where need be."""
    if plant in USUAL:
        return 2
    if Path(plant).suffix == ".json":
        try:
            axes = json.loads(Path(plant).read_text()).get("axes")
        except (OSError, ValueError, AttributeError):  # told below
            axes = None
        if isinstance(axes, list) and axes:
            return len(axes)
    return import_module("jcontour.app.catalogue.choices").machine_named(plant).model.axes
