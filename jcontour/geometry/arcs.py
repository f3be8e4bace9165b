"""Circular arcs as toolpaths give them, in a plane of complex numbers.

They come by centre or by radius, and their ends may lie slightly off the circle.
"""

import cmath
import math
from collections.abc import Iterator

from jcontour.geometry.toolpath_rules import INCH, MM, SHORTEST, ToolpathError

# difference between both radii of an arc, as LinuxCNC allows it: what rounding of the end and the
# centre to a hundredth of a millimetre or a thousandth of an inch makes, or a part of the radius
ARC_SLACK = 0.02 * math.sqrt(2.0) * MM  # [m] of programs in mm
ARC_SLACK_INCH = 0.002 * math.sqrt(2.0) * INCH  # [m] of programs in inches
ARC_SLACK_RELATIVE = 1e-3  # of the larger radius, up to
ARC_SLACK_TIMES = 100.0  # of the slack
# how much too short a radius (R) may be, as Grbl allows it
RADIUS_SLACK = 5e-6  # [m]
RADIUS_SLACK_RELATIVE = 1e-3  # of the radius, up to RADIUS_SLACK_MOST
RADIUS_SLACK_MOST = 0.5e-3  # [m]


def centre_from_radius(
    start: complex, end: complex, radius: float, counter_clockwise: bool
) -> complex:
    """Centre of the arc of a radius [m], below zero for the long way round.

    Raises:
        ToolpathError: start and end are the same, or farther apart than the radius reaches.
    """
    chord = end - start
    half = 0.5 * abs(chord)
    if 2 * half < SHORTEST:
        raise ToolpathError(
            "an arc by radius (R) needs an end apart from its start; a full circle needs I, J or K"
        )
    if abs(radius) < SHORTEST or not _reaches(abs(radius), half):
        raise ToolpathError(
            f"a radius of {abs(radius) / MM:.6g} mm does not reach the end of the arc, "
            f"{2 * half / MM:.6g} mm away"
        )
    height = math.sqrt(max(radius**2 - half**2, 0.0))
    to_the_left = counter_clockwise == (radius > 0)
    return start + chord * (0.5 + (1j if to_the_left else -1j) * height / abs(chord))


def arcs_between(
    start: complex, end: complex, centre: complex, counter_clockwise: bool, slack: float = ARC_SLACK
) -> Iterator[tuple[complex, complex, float]]:
    """Ends, centres and signed angles of the one or two arcs which run exactly from start to end.

    The given centre may be slightly off: both radii may differ by `slack` [m], or by a thousandth
    up to a hundred times that.

    Raises:
        ToolpathError: the end is off its circle, or there is no radius.
    """
    first, last = abs(start - centre), abs(end - centre)
    if not _same_radius(first, last, slack):
        raise ToolpathError(
            f"the end of the arc is off its circle: the radius is {first / MM:.6g} mm at the start "
            f"and {last / MM:.6g} mm at the end, {abs(first - last) / MM:.3g} mm apart"
        )
    if min(first, last) < SHORTEST:
        raise ToolpathError("an arc without a radius")
    chord = end - start
    if abs(chord) < SHORTEST:
        yield start, centre, math.copysign(math.tau, 1 if counter_clockwise else -1)
        return
    angle = _angle(start - centre, end - centre, counter_clockwise)
    from_middle = (centre - 0.5 * (start + end)) / chord
    if abs(angle) > math.pi and abs(from_middle.real * chord) > SHORTEST:
        middle = centre + (start - centre) * cmath.rect(0.5 * (first + last) / first, 0.5 * angle)
        yield from arcs_between(start, middle, centre, counter_clockwise, slack)
        yield from arcs_between(middle, end, centre, counter_clockwise, slack)
        return
    centre = 0.5 * (start + end) + 1j * from_middle.imag * chord  # on the bisector of the chord
    yield end, centre, _angle(start - centre, end - centre, counter_clockwise)


def _angle(first: complex, last: complex, counter_clockwise: bool) -> float:
    """Signed angle from one radius to the other, a whole turn when they agree."""
    turned = cmath.phase(last / first) * (1 if counter_clockwise else -1) % math.tau
    turned = math.tau if turned * abs(first) < SHORTEST else turned
    return turned if counter_clockwise else -turned


def _same_radius(first: float, last: float, slack: float) -> bool:
    gap = abs(first - last)
    relative = ARC_SLACK_RELATIVE * max(first, last)
    return gap <= slack or gap <= min(relative, ARC_SLACK_TIMES * slack)


def _reaches(radius: float, half: float) -> bool:
    gap = half - radius
    return gap <= max(RADIUS_SLACK, min(RADIUS_SLACK_RELATIVE * radius, RADIUS_SLACK_MOST))
