"""An entry of the catalogue."""

from collections.abc import Callable
from typing import Any, NamedTuple

from experiments.machines.machine import Machine


class Entry(NamedTuple):
    """One thing with a name.

    Attributes:
        make: plants () -> Plant; controllers (name, machine, flags) -> Design; contours (pace) ->
            Job or Motion.
        line: what it is, in one line.
        smooth: differentiable where it is used.
        stable: its loop settles.
        still: a plant that stays where it is at rest without control.
        on: name of the machine that it is for, or of one of them; a controller is for all that have
            what `NEEDS` says of it.
    """

    make: Callable[..., Any]
    line: str
    smooth: bool = True
    stable: bool = True
    still: bool = True
    on: str = "bridgeport"


class Need(NamedTuple):
    """What a controller needs of a machine, in words, and whether one has it."""

    words: str
    met_by: Callable[[Machine], bool]
