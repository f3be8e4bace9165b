"""Arcs that the words of a line ask for, by a centre (I, J, K) or a radius (R), and P turns."""

import math

from jcontour.geometry.arcs import ARC_SLACK, ARC_SLACK_INCH, arcs_between, centre_from_radius
from jcontour.geometry.gcode.expressions import whole
from jcontour.geometry.gcode.modes import Modes
from jcontour.geometry.gcode.move import PLANES, Point
from jcontour.geometry.toolpath_rules import INCH, ToolpathError

Arcs = list[tuple[complex, complex, float]]  # end, centre [m] and angle [rad] of one after another
CENTRES = "IJK"
FARTHEST_CENTRE = 1e4  # [m]: CAM systems write arcs that bend by less than a micrometre
MOST_TURNS = 10_000  # of an arc, and holes of a cycle


def arcs_of(
    values: dict[str, float], here: Point, there: Point, modes: Modes, counter_clockwise: bool
) -> Arcs:
    """Arcs in the plane in force from one point to another, both of the program [m].

    Raises:
        ToolpathError: neither a centre nor a radius, or both; one that does not fit the points.
    """
    first, second, normal = PLANES[modes.plane]
    letters = CENTRES[first], CENTRES[second]
    if any(letter in values for letter in CENTRES) == ("R" in values):
        raise ToolpathError("an arc needs either a centre (I, J, K) or a radius (R)")
    if values.get(CENTRES[normal]):
        raise ToolpathError(f"{CENTRES[normal]} is not in the plane of G{modes.plane // 10}")
    if "R" not in values and modes.absolute_centres and not values.keys() >= set(letters):
        raise ToolpathError(f"a centre under G90.1 needs {' and '.join(letters)}")
    start, end = complex(here[first], here[second]), complex(there[first], there[second])
    lengths = [values.get(letter, 0.0) * modes.unit for letter in ("R", *letters)]
    if not all(abs(length) <= FARTHEST_CENTRE for length in lengths):
        raise ToolpathError(f"the centre of an arc is farther than {FARTHEST_CENTRE:g} m away")
    offset = complex(*lengths[1:])
    if "R" in values:
        centre = centre_from_radius(start, end, lengths[0], counter_clockwise)
    else:
        centre = offset if modes.absolute_centres else start + offset
    slack = ARC_SLACK_INCH if modes.unit == INCH else ARC_SLACK
    try:
        arcs = list(arcs_between(start, end, centre, counter_clockwise, slack))
    except ToolpathError as error:
        if "R" in values or modes.absolute_centres:
            raise
        try:
            list(arcs_between(start, end, offset, counter_clockwise, slack))
        except ToolpathError:
            raise error from None
        text = "in absolute coordinates its centre fits: G90.1 says so"
        raise ToolpathError(f"{error}; {text}") from None
    turns = whole(values.get("P", 1.0), "P of an arc")
    if not 1 <= turns <= MOST_TURNS:
        raise ToolpathError(f"P of an arc needs to be 1 to {MOST_TURNS}, received {turns}")
    if turns > 1:
        whole_turn = math.copysign(math.tau, arcs[0][2])
        arcs = [(start, arcs[0][1], whole_turn)] * (turns - 1) + arcs
    return arcs
