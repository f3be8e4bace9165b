"""Parameters that the machine sets: its position, its offsets and its modes."""

import math

from jcontour.geometry.gcode.machine import Machine
from jcontour.geometry.toolpath_rules import INCH, MM, ToolpathError

AXES = 3
STANDING = frozenset(f"{kind}{axis}" for kind in ("_", "_abs_") for axis in "abcuvw")  # at 0
ROTATION = 9  # of a work system, behind the places of its nine axes
PLASMA_FEED = "_hal[plasmac.cut-feed-rate]"  # of the material, on plasma tables of LinuxCNC
VERSION, RELEASE = 2.0, 9.0  # of LinuxCNC, whose language this is


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
    if isinstance(key, str):
        return _named(machine, key, call_level) if key.startswith("_") else None
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
    if 0 <= system < len(offsets.origins):
        if axis < AXES:
            return offsets.origins[system][axis] / MM
        if axis == ROTATION:
            return math.degrees(offsets.angles[system])
    return None


def _named(machine: Machine, key: str, call_level: int) -> float | None:
    modes, unit = machine.modes, machine.modes.unit
    system, places = machine.offsets.system, {"_abs_": machine.at}
    places["_"] = machine.offsets.in_program(machine.at)
    values = {
        **{
            f"{kind}{axis}": length / unit
            for kind, place in places.items()
            for axis, length in zip("xyz", place, strict=True)
        },
        "_feed": (modes.feed or 0.0) * 60.0 / unit,
        "_metric": float(unit == MM),
        "_imperial": float(unit == INCH),
        "_absolute": float(not modes.incremental),
        "_incremental": float(modes.incremental),
        "_ijk_absolute_mode": float(modes.absolute_centres),
        "_inverse_time": float(modes.inverse_time),
        "_units_per_minute": float(not modes.inverse_time),
        "_units_per_rev": 0.0,
        "_plane": float(modes.plane),
        "_motion_mode": 800.0 if machine.motion is None else float(machine.motion),
        "_ccomp": 400.0 if machine.compensation is None else float(machine.compensation.code),
        "_coord_system": 530.0 + 10 * system if system <= 6 else 584.0 + system,
        "_retract_r_plane": float(modes.to_r_plane),
        "_retract_old_z": float(not modes.to_r_plane),
        "_current_tool": float(machine.tool),
        "_selected_tool": float(machine.next_tool),
        "_call_level": float(call_level),
        "_line": float(machine.tracer.line),
        "_task": 0.0,  # nothing real is moved, as in a preview
        "_vmajor": VERSION,
        "_vminor": RELEASE,
    }
    return 0.0 if key in STANDING else values.get(key)
