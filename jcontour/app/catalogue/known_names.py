"""Names on a command line, checked before heavy imports: a slip is answered at once."""

import errno
import math
import stat
from dataclasses import fields
from pathlib import Path
from typing import Any

from jcontour.app.catalogue.entries import CONSTRAINED, CONTOURS, CONTROLLERS, MACHINES, PREFIXES
from jcontour.app.catalogue.own_classes import FILE, check_ending, own_name, perhaps
from jcontour.app.files.checks import EXAMPLE, MachineError, named
from jcontour.app.plain_numbers import named_numbers

OF_JERK_LAW = {  # flags of the jerk-limited law, and what the other one does
    "jerk": "its acceleration changes at once",
    "corner_tolerance_um": "it passes corners without leaving the path, and its speed jumps there",
}
FIRST_LINES = 1000  # of a toolpath file, checked at once: thousands more take longer than a moment


def check_plant(name: str) -> None:
    """Raise ValueError unless a machine has this name, or it is that of a file."""
    if name in MACHINES or own_name(name):
        return
    check_ending("plant", name)
    # Whether a Python file is named without a class, or a class without its `.py`
    if not Path(name).suffix or (Path(name).suffix == ".py" or ".py:" in name):
        raise ValueError(
            f"plant: there is none named {name!r}; {perhaps(name, MACHINES)}give "
            f"{', '.join(MACHINES)}, a JSON file ({EXAMPLE}), or a class of yours as {FILE}"
        )


def check_contour(name: str) -> None:
    """Raise ValueError unless a contour has this name, or it is that of a file."""
    if name not in CONTOURS and Path(name).is_dir():
        raise ValueError(
            f"contour: {name} is a folder, no contour; `jcontour front --against feed`, "
            "`precompensate`, `check`, `export` and `report` take the folder of a run; give one of "
            f"{', '.join(CONTOURS)}, or a toolpath file"
        )
    if name not in CONTOURS and not Path(name).suffix:
        raise ValueError(
            f"contour: there is none named {name!r}; {perhaps(name, CONTOURS)}"
            f"give one of {', '.join(CONTOURS)}, or a toolpath file"
        )


def check_controller(name: str) -> None:
    """Raise ValueError unless a controller has this name.

    Whether it suits the machine is asked later.
    """
    short = {name.removeprefix(prefix) for name in CONTROLLERS for prefix in PREFIXES}
    known = {*short, *CONSTRAINED}
    if name in known or own_name(name):
        return
    check_ending("controller", name)
    raise ValueError(
        f"controller: there is none named {name!r}; {perhaps(name, known)}"
        f"give one of {', '.join(CONTROLLERS)}, or a class of yours as {FILE}"
    )


def check_flags(flags: Any) -> None:
    """Check numbers, feed law, plant, controller, contour and parts of any command."""
    for name, value in vars(flags).items():
        if isinstance(value, float) and not math.isfinite(value):
            flag = name.replace("_", "-")
            raise ValueError(f"{flag}: needs a finite number, received {value}")
    for flag in ("weights", "vary"):
        for words in getattr(flags, flag, ()):
            named_numbers(flag, words)
    if getattr(flags, "feed_law", None) == "trapezoidal":  # what this law does not look at
        for one in fields(flags):
            if one.name in OF_JERK_LAW and getattr(flags, one.name) != one.default:
                raise ValueError(
                    f"{one.name.replace('_', '-')}: --feed-law trapezoidal has none, "
                    f"{OF_JERK_LAW[one.name]}; leave it out, or take --feed-law jerk"
                )
    plant, controller = getattr(flags, "plant", None), getattr(flags, "controller", None)
    contour, parts = getattr(flags, "contour", None), getattr(flags, "parts", ())
    if plant is not None:
        check_plant(plant)
        _check_file(plant, MACHINES, f"; {EXAMPLE}")
    if controller is not None:
        check_controller(controller)
        if own_name(controller):
            _check_file(controller, {})
    if getattr(flags, "resume", None):  # parts beside it are refused, whatever they are
        return
    for name in (*parts, *([contour] if contour else [])):
        if getattr(flags, "against", None) == "feed" and Path(name).is_dir():  # a run
            continue
        check_contour(name)
        _check_file(name, CONTOURS)
        if name not in CONTOURS:
            _check_lines(Path(name), flags)


def _check_file(name: str, known: dict[str, Any], where_missing: str = "") -> None:
    """Refuse what is no known name and no file; the end of the line helps where there is none."""
    if name in known:
        return
    own = own_name(name)
    path = Path(name) if own is None else own.path
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise OSError(errno.EINVAL, "not a regular file but a device, pipe or socket")
        with path.open("rb"):
            pass
    except OSError as error:
        help = where_missing if own is None and isinstance(error, FileNotFoundError) else ""
        raise MachineError(f"{path}: cannot be read ({error.strerror or error}){help}") from None


def _check_lines(path: Path, flags: Any) -> None:
    """Carry out the first lines of a toolpath file on three axes, with the feed and tools of flags.

    It refuses nothing that is right later. The whole file is checked when it is read.
    """
    from jcontour.geometry.gcode.modes import read_tool_table
    from jcontour.geometry.gcode.programs import files_beside, interpreted
    from jcontour.geometry.toolpath_rules import (
        DRAWINGS,
        ToolpathError,
        csv_points,
        lines_of,
        read_program,
        read_text,
    )

    if path.suffix.lower() in DRAWINGS:  # read as a whole
        return
    feed = None if getattr(flags, "feed_mm_per_min", None) is None else 1.0
    table = getattr(flags, "tool_table", None)
    tools = None if table is None else read_tool_table(table)
    with named(path, ToolpathError):
        if path.suffix.lower() == ".csv":
            csv_points(lines_of(read_text(path))[:FIRST_LINES])
        else:
            lines = lines_of(read_program(path))
            interpreted(lines, 3, feed, files_beside(path), FIRST_LINES, tools)
