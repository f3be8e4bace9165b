"""What a machine says of itself: parameters that it sets, and what a program may mean otherwise."""

import math
from collections.abc import Sequence

from jcontour.geometry.gcode._machine import Machine
from jcontour.geometry.gcode.moves import Stop
from jcontour.geometry.toolpath_rules import INCH, MM, ToolpathError

AXES = 3
STANDING = frozenset(f"{kind}{axis}" for kind in ("_", "_abs_") for axis in "abcuvw")  # at 0
ROTATION = 9  # of a work system, behind the places of its nine axes
PLASMA_FEED = "_hal[plasmac.cut-feed-rate]"  # of the material, on plasma tables of LinuxCNC
VERSION, RELEASE = 2.0, 9.0  # of LinuxCNC, whose language this is
LONG_DWELL = 60.0  # [s]: nobody lets a spindle come up to speed for longer


def machine_values(machine: Machine, key: int | str, call_level: int) -> float | None:
    """Value of a parameter that the machine sets; None for all others.

    Lengths are in the unit in force, those that a control keeps (5161 to 5390) in millimetres.

    Raises:
        ToolpathError: the feed that a plasma table keeps, where none is given.
    """
    unit, offsets = machine.modes.unit, machine.offsets
    if key == PLASMA_FEED:
        if machine.first_feed is None:
            raise ToolpathError(
                "the feed is in the plasma table's list; --feed-mm-per-min gives one"
            )
        return machine.first_feed * 60.0 / unit
    if isinstance(key, int):
        unit, offsets = machine.modes.unit, machine.offsets
        at_axis = {
            5021: (machine.at, unit),
            5081: (offsets.tool, unit),
            5161: (machine.homes[280], MM),
            5181: (machine.homes[300], MM),
            5211: (offsets.kept_shift, MM),
            5420: (offsets.in_program(machine.at), unit),
        }
        for first, (point, length) in at_axis.items():
            if first <= key < first + AXES:
                return point[key - first] / length
        alone = {5210: offsets.shifted, 5220: offsets.system, 5400: machine.tool}
        if key in alone:
            return float(alone[key])
        system, axis = divmod(key - 5221, 20)
        if 0 <= system < len(offsets.origins) and axis < AXES:
            return offsets.origins[system][axis] / MM
        if 0 <= system < len(offsets.origins) and axis == ROTATION:
            return math.degrees(offsets.angles[system])
        return None
    if not key.startswith("_"):
        return None
    if key in STANDING:
        return 0.0
    kind, modes, system = key[:-1], machine.modes, offsets.system
    if kind in ("_", "_abs_") and key[-1] in "xyz":
        place = machine.at if kind == "_abs_" else offsets.in_program(machine.at)
        return place["xyz".index(key[-1])] / unit
    values = {
        "_feed": (modes.feed or 0.0) * 60.0 / unit,
        "_metric": unit == MM,
        "_imperial": unit == INCH,
        "_absolute": not modes.incremental,
        "_incremental": modes.incremental,
        "_ijk_absolute_mode": modes.absolute_centres,
        "_inverse_time": 0.0,
        "_units_per_minute": 1.0,
        "_units_per_rev": 0.0,
        "_plane": modes.plane,
        "_motion_mode": 800 if machine.motion is None else machine.motion,
        "_ccomp": 400 if machine.compensation is None else machine.compensation.code,
        "_coord_system": 530 + 10 * system if system <= 6 else 584 + system,
        "_retract_r_plane": modes.to_r_plane,
        "_retract_old_z": not modes.to_r_plane,
        "_current_tool": machine.tool,
        "_selected_tool": machine.next_tool,
        "_call_level": call_level,
        "_line": machine.tracer.line,
        "_task": 0.0,  # nothing real is moved, as in a preview
        "_vmajor": VERSION,
        "_vminor": RELEASE,
    }
    return float(values[key]) if key in values else None


def warnings_of(machine: Machine, stops: Sequence[Stop]) -> tuple[str, ...]:
    """Questions about the program's unit, a first move without a code, dwells, skipped lines.

    Args:
        machine: that has carried out the program.
        stops: those that matter.
    """
    warnings = []
    if not machine.modes.unit_said:
        warnings.append("the program has no G20 or G21: its lengths are read as mm")
    if machine.assumed_at:
        warnings.append(
            f"line {machine.assumed_at}: a move before any of G0 to G3 is read as G0; "
            "LinuxCNC refuses it"
        )
    long = [stop for stop in stops if stop.lasting > LONG_DWELL]
    if long:
        more = f" and {len(long) - 1} more" if len(long) > 1 else ""
        warnings.append(
            f"line {long[0].line}: a dwell of {long[0].lasting:.6g} s{more}; P is in seconds "
            "here, some controls mean milliseconds"
        )
    if machine.skipped:
        first, count = min(machine.skipped.values()), len(machine.skipped)
        lines = "1 line that begins" if count == 1 else f"{count} lines that begin"
        place = f"line {first}" if count == 1 else f"the first at line {first}"
        warnings.append(f"{lines} with / skipped, as with block delete on: {place}")
    return tuple(warnings)
