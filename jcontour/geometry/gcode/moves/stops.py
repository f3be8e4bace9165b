"""Stops of a program: which of them a run has, and what is said of them."""

import math
from collections.abc import Iterable, Sequence

from jcontour.geometry.gcode.moves.move import Move, Stop

MOST_TOLD = 6  # reasons to stop that are told
DWELL, UP_OR_DOWN = "G4", "Z"  # why
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
    exact = [
        f"{why} from line {by_reason[why][0].line}: stops {where}"
        for why, where in EXACT.items()
        if why in by_reason
    ]
    waiting = by_reason.get(UP_OR_DOWN, [])
    others = {why: some for why, some in by_reason.items() if why not in EXACT}
    count = sum(map(len, others.values()))
    told = [f"{count} stop{'' if count == 1 else 's'}: {_reasons(others)}"] if others else []
    return "; ".join([*told, *exact, *([_waiting(waiting)] if waiting else [])])


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


def _reasons(reasons: dict[str, list[Stop]]) -> str:
    told = [_reason(why, some) for why, some in list(reasons.items())[:MOST_TOLD]]
    more = [f"{len(reasons) - MOST_TOLD} more reasons"] if len(reasons) > MOST_TOLD else []
    return ", ".join([*told, *more])


def _reason(why: str, some: Sequence[Stop]) -> str:
    where = (
        f"at line {some[0].line}"
        if len(some) == 1
        else f"{len(some)} times from line {some[0].line}"
    )
    lasting = sum(stop.lasting for stop in some)
    return f"{why} {where}" + (f" ({lasting:.6g} s)" if lasting else "")


def _waiting(moves: Sequence[Stop]) -> str:
    """How long Z moves alone, and what the cycle time lacks."""
    at_feed = [move.besides for move in moves if not math.isnan(move.besides)]
    told = [f"Z alone takes {sum(at_feed):.4g} s at its feed"] if at_feed else []
    rapid = len(moves) - len(at_feed)
    if rapid:
        named = "1 rapid move of Z takes" if rapid == 1 else f"{rapid} rapid moves of Z take"
        told.append(f"{named} no time")
    return "; ".join(told)


def ignored_words(words: Iterable[str], stops: Sequence[Stop]) -> tuple[str, ...]:
    """Words without meaning for the path, sorted; those that stop it have one."""
    stopping = {word for stop in stops for word in stop.why.split()}
    return tuple(sorted(set(words) - stopping))
