"""Lines of printers' firmware that move nothing here: a command, and words of its own.

A printer has one command a line, whose letters mean what the command says: X in `M201 X5000` is an
acceleration. On a mill it would be a place. So such a line is left out in programs for printers
alone, which their heaters, their checks or their extruder (E) show.
"""

import re
from collections.abc import Callable, Iterable
from typing import NamedTuple

from jcontour.geometry.gcode.language.codes import STOPPING
from jcontour.geometry.toolpath_rules import ToolpathError

NUMBERED = r"\s*(?:[Nn][0-9]+\s*)?"
COMMAND = re.compile(
    rf"{NUMBERED}(?:([Mm]0*[0-9]+(?:\.[0-9]+)?|[Gg]0*(?:1[01]|29|3[234])(?:\.[0-9]+)?)(?![0-9.])"
    r"|[Tt][xXcC?](?!\S)"  # the next tool is asked for
    r"|([A-Za-z_]{3}[A-Za-z0-9_]*)(?!\S))"  # a macro's name
)
MARK = re.compile(
    rf"{NUMBERED}(?:M1(?:04|09|40|90)\s*[RST]|M115\s*U|M862\.|EXCLUDE_OBJECT"
    r"|G29(?:\.[0-9]|\s*[AGHJPSTW])"  # Fanuc's G29 has X, Y and Z alone
    # motors of axes, which have no numbers then
    r"|M(?:1[78]|8[2-9]|9[0-2]|[1-9][0-9]{2,})(?:\s+[A-Z][-+0-9.]*)*\s+[XYZE](?:\s|;|$)"
    r"|(?:G0?[0-3]|G92)(?![0-9.])[^;(]*?(?:\sE[+-]?[0-9.]|[0-9.]E[+-]?(?:[0-9]+\.|\.[0-9])))",
    re.IGNORECASE,
)
GLUED = re.compile(r"[^;(]*?(?:[0-9.][eE][+-]?(?:[0-9]+\.|\.[0-9])|[Gg]0*92[eE])")
TEXT = re.compile(r'"[^"]*"|\([^)]*\)|;.*')
CODE = re.compile(r"(?:^|\s)[Gg][0-9]")
OWN = frozenset({17, 18, *range(82, 93), *range(100, 10_000)})  # M codes with words of their own
MOVING = {  # that change where later moves go, or how often
    "M206": "an offset of its zero",
    "M808": "a loop of a printer",
    "SET_GCODE_OFFSET": "an offset of its zero",
    "SET_KINEMATIC_POSITION": "an offset of its zero",
    "RESTORE_GCODE_STATE": "a state kept before",
    "FORCE_MOVE": "a move of a motor",
}


class PrinterLine(NamedTuple):
    """A line that is left out.

    Attributes:
        word: what is told of it.
        stops: whether X and Y wait meanwhile.
    """

    word: str
    stops: bool = False


def is_for_a_printer(lines: Iterable[str]) -> bool:
    """Whether a program has a line that only printers' programs have.

    >>> is_for_a_printer(["G21", "G1 X1 Y2 E.5"]), is_for_a_printer(["G1 X1E3", "M106 S9"])
    (True, False)
    """
    return any(MARK.match(line) for line in lines)


def glues_extruder(lines: Iterable[str]) -> bool:
    """Whether E stands right behind a number for an extruder, as an exponent has no point.

    >>> glues_extruder(["G1X10Y5E0.3"]), glues_extruder(["G1 X1E3", "G1 X1 E.5"])
    (True, False)
    """
    return any(GLUED.match(line) for line in lines)


def printer_line(line: str, prints: Callable[[], bool]) -> PrinterLine | None:
    """What is told of a line of a printer that moves nothing here; None for any other.

    >>> printer_line('M862.3 P "MK3S" ; model', lambda: True)
    PrinterLine(word='M862.3', stops=False)

    Args:
        line: of a program.
        prints: says whether the program is for a printer, asked only where it matters.

    Raises:
        ToolpathError: it changes where later moves go, or repeats them.
    """
    found = COMMAND.match(line)
    if found is None:
        return None
    rest = TEXT.sub("", line[found.end() :])
    command = _command(found)
    if not _is_own(command, rest) or not (command == "G11" or prints()):
        return None
    if command in MOVING:
        raise ToolpathError(f"'{command}' is not supported ({MOVING[command]})")
    return PrinterLine(command, _stops(command))


def _command(found: re.Match[str]) -> str:
    """The command as it is told: M84, G29.1, T, the name of a macro."""
    if found[2]:
        return found[2].upper()
    if not found[1]:
        return "T"
    whole, dot, part = found[1].partition(".")
    return f"{whole[0].upper()}{int(whole[1:])}{dot}{part}"


def _is_own(command: str, rest: str) -> bool:
    """Whether the rest of the line belongs to a command that moves nothing."""
    if CODE.search(rest):
        return False
    if command in ("G10", "G11"):  # draws the filament back, and forward again
        return not rest.strip()
    if command[0] == "M" and command[1:].isdigit():
        return int(command[1:]) in OWN
    return True


def _stops(command: str) -> bool:
    if command[0] == "M":
        return command[1:].isdigit() and int(command[1:]) in STOPPING
    return command[0] == "G" and command[1].isdigit()
