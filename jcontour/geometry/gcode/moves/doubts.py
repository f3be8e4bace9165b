"""Questions about a program: what of it may be meant otherwise."""

from collections.abc import Sequence

from jcontour.geometry.gcode.moves.modes import PLANES
from jcontour.geometry.gcode.moves.move import Move, Stop

LONG_DWELL = 60.0  # [s]: nobody lets a spindle come up to speed for longer


def doubts_of(
    assumed_at: int, stops: Sequence[Stop], unit_said: bool, skipped: Sequence[int] = ()
) -> tuple[str, ...]:
    """Questions about a program's unit, its stops, lines left out, and a first move without a code.

    >>> doubts_of(3, (), unit_said=True)
    ('line 3: a move before any of G0 to G3 is read as G0; LinuxCNC refuses it',)

    Args:
        assumed_at: line of that move; 0 where there is none.
        stops: of the program.
        unit_said: whether it says what its unit is.
        skipped: lines that begin with /.
    """
    unit = None if unit_said else "the program has no G20 or G21: its lengths are read as mm"
    said = (unit, _assumed_rapid(assumed_at), long_dwells(stops), _block_delete(skipped))
    return tuple(filter(None, said))


def plane_left_out(moves: Sequence[Move], axes: int) -> tuple[str, ...]:
    """Word about cuts in planes with Z, which two axes do not have; none where there are none.

    >>> origin, end = (0.0, 0.0, 0.0), (1e-3, 0.0, -1e-3)
    >>> plane_left_out([Move(origin, end, end, 0.0, 1, 1e-3, False, 7)], axes=2)
    ('from line 7 the plane is G18, as on a lathe: two axes run X and Y, Z is left out',)
    """
    with_z = [move for move in moves if move.normal != PLANES[170][2] and not move.rapid]
    if axes > 2 or not with_z:
        return ()
    first = with_z[0]
    (plane,) = (code for code, axis in PLANES.items() if axis[2] == first.normal)
    lathe = ", as on a lathe" if plane == 180 else ""
    return (
        f"from line {first.line} the plane is G{plane // 10}{lathe}: two axes run X and Y, "
        "Z is left out",
    )


def long_dwells(stops: Sequence[Stop]) -> str | None:
    """Question about dwells so long that milliseconds may be meant; None where there are none.

    >>> long_dwells([Stop(1, (0.0, 0.0, 0.0), 500.0, 12, "G4")])
    'line 12: a dwell of 500 s; P is in seconds here, some controls mean milliseconds'
    """
    long = [stop for stop in stops if stop.lasting > LONG_DWELL]
    if not long:
        return None
    more = f" and {len(long) - 1} more" if len(long) > 1 else ""
    return (
        f"line {long[0].line}: a dwell of {long[0].lasting:.6g} s{more}; P is in seconds here, "
        "some controls mean milliseconds"
    )


def _block_delete(skipped: Sequence[int]) -> str | None:
    """Word about lines that a control carries out with its block-delete switch off."""
    if not skipped:
        return None
    lines = "1 line that begins" if len(skipped) == 1 else f"{len(skipped)} lines that begin"
    first = "" if len(skipped) == 1 else " the first at"
    return f"{lines} with / skipped, as with block delete on:{first} line {min(skipped)}"


def _assumed_rapid(line: int) -> str | None:
    if not line:
        return None
    return f"line {line}: a move before any of G0 to G3 is read as G0; LinuxCNC refuses it"
