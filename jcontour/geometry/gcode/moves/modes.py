"""Modes of a machine control: what stays in force from line to line."""

from dataclasses import dataclass

from jcontour.geometry.toolpath_rules import INCH, MM

# first and second axis of the plane, then its normal
PLANES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0)}


@dataclass(slots=True)
class Modes:
    """Modes in force, with those that a control has when it is switched on.

    Attributes:
        plane: code of the plane of arcs and cycles, G17, G18 or G19, in tenths.
        unit: length of one [m].
        unit_said: whether the program has said so.
        incremental: whether end points count from the start of the move.
        absolute_centres: whether centres of arcs do not.
        inverse_time: whether F is one over the minutes of a move.
        to_r_plane: whether cycles go back to R only.
        feed: speed along the path [m/s], None before the first F.
        path: code of how joints of moves are passed: G61 stops in corners, G61.1 after every move.
    """

    plane: int = 170
    unit: float = MM
    unit_said: bool = False
    incremental: bool = False
    absolute_centres: bool = False
    inverse_time: bool = False
    to_r_plane: bool = False
    feed: float | None = None
    path: int = 640

    def switch(self, codes: dict[str, int]) -> None:
        """Put codes in force, by their groups."""
        if "plane" in codes:
            self.plane = codes["plane"]
        if "units" in codes:
            self.unit = INCH if codes["units"] in (200, 700) else MM
            self.unit_said = True
        if "distance" in codes:
            self.incremental = codes["distance"] == 910
        if "centres" in codes:
            self.absolute_centres = codes["centres"] == 901
        if "return" in codes:
            self.to_r_plane = codes["return"] == 990
        self.path = codes.get("path", self.path)
