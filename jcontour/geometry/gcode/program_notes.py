"""Notes on a program: which stops a run has, and what of it may be meant otherwise."""

import math
from collections.abc import Iterable, Sequence

from jcontour.geometry.gcode.move import PLANES, UP_OR_DOWN, Move, Stop

MOST_TOLD = 6  # reasons to stop that are told
LONG_DWELL = 60.0  # [s]: nobody lets a spindle come up to speed for longer
START = "start"  # why, of what comes before the first cut
EXACT = {"G61.1": "after every move", "G61": "in corners"}  # why, and where


def stops_in_cuts(stops: Sequence[Stop], moves: Sequence[Move]) -> list[Stop]:
    """Stops from the first cut on, to the end of the last one or until Z leaves it alone."""
    cuts = [k for k, move in enumerate(moves) if not move.rapid]
    if not cuts:
        return []
    found = [stop for stop in stops if cuts[0] < stop.after <= cuts[-1] + 1]
    leaves = (cuts[-1] + 1, UP_OR_DOWN)
    left = (k for k, stop in enumerate(found) if (stop.after, stop.why) == leaves)
    return found[: next(left, len(found))]


def told_stops(stops: Sequence[Stop]) -> str:
    """Where and why a motion stops, in words; empty where it does not.

    What Z alone takes while two axes wait is told apart.

    >>> told_stops([Stop(1, (0.0, 0.0, 0.0), 0.0, 4, "M3"), Stop(2, (0.0, 0.0, 0.0), 0.5, 9, "G4")])
    '2 stops: M3 at line 4, G4 at line 9 (0.5 s)'
    """
    by_reason: dict[str, list[Stop]] = {}
    for stop in stops:
        by_reason.setdefault(stop.why, []).append(stop)
    others = {why: some for why, some in by_reason.items() if why not in EXACT}
    reasons = []
    for why, some in list(others.items())[:MOST_TOLD]:
        first, lasting = f"line {some[0].line}", sum(stop.lasting for stop in some)
        where = f"at {first}" if len(some) == 1 else f"{len(some)} times from {first}"
        reasons.append(f"{why} {where}" + (f" ({lasting:.6g} s)" if lasting else ""))
    if len(others) > MOST_TOLD:
        reasons.append(f"{len(others) - MOST_TOLD} more reasons")
    count = sum(map(len, others.values()))
    told = [f"{count} stop{'' if count == 1 else 's'}: {', '.join(reasons)}"] if others else []
    told += [
        f"{why} from line {by_reason[why][0].line}: stops {where}"
        for why, where in EXACT.items()
        if why in by_reason
    ]
    waiting = [stop.besides for stop in by_reason.get(UP_OR_DOWN, [])]
    at_feed = [lasting for lasting in waiting if not math.isnan(lasting)]
    if at_feed:
        told.append(f"Z alone takes {sum(at_feed):.4g} s at its feed")
    rapid = len(waiting) - len(at_feed)
    if rapid:
        named = "1 rapid move of Z takes" if rapid == 1 else f"{rapid} rapid moves of Z take"
        told.append(f"{named} no time")
    return "; ".join(told)


def told_left_out(stops: Iterable[Stop], run: Iterable[Stop]) -> str:
    """What Z alone takes where a run does not go, as in a first plunge; empty for nothing.

    Args:
        stops: of a program.
        run: those of them that are in its run.
    """
    kept = {id(stop) for stop in run}
    lost = [stop.besides for stop in stops if id(stop) not in kept and stop.besides > 0]
    if not lost:
        return ""
    return f"left out: {sum(lost):.4g} s of Z alone before the first cut or behind the last one"


def ignored_words(words: Iterable[str], stops: Sequence[Stop]) -> tuple[str, ...]:
    """Words without meaning for the path, sorted; those that stop it have one."""
    stopping = {word for stop in stops for word in stop.why.split()}
    return tuple(sorted(set(words) - stopping))


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
    said = [] if unit_said else ["the program has no G20 or G21: its lengths are read as mm"]
    if assumed_at:
        said.append(
            f"line {assumed_at}: a move before any of G0 to G3 is read as G0; LinuxCNC refuses it"
        )
    said += filter(None, [long_dwells(stops)])
    if skipped:
        lines = "1 line that begins" if len(skipped) == 1 else f"{len(skipped)} lines that begin"
        first = "" if len(skipped) == 1 else " the first at"
        place = f"{first} line {min(skipped)}"
        said.append(f"{lines} with / skipped, as with block delete on:{place}")
    return tuple(said)


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
