"""Records of a machine: commands and positions of its axes over time, from a log.

Columns are found by their names, x_command and x_position for the axis X beside `time` [s], or by
flags that name them. A name may end in its unit: time_ms, x_command_V, x_position_um, Time [ms].
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour.app.files.checks import METRES
from jcontour.app.files.clock import SECONDS, EvenPart, likely_unit, longest_even_part
from jcontour.app.files.log_table import Table, read_table

COMMAND_UNITS = ("v", "a", "n", "nm", "mm/s", "mm_per_s")  # in lower case
COMMAND_WORDS = ("command", "control", "u", "cmd", "torque", "velocity_command", "speed_command")
POSITION_WORDS = ("position", "pos", "y", "q", "actual", "measured")
TIME_WORDS = ("time", "t", "timestamp")


@dataclass(frozen=True)
class LogColumns:
    """Where a log holds what.

    Attributes:
        time: name of the column; found by itself when None.
        command, position: names by axis; found by themselves when empty.
        length_unit: of the positions, where their names do not say.
        period: [s]; a column of time is then not read.
    """

    time: str | None = None
    command: tuple[str, ...] = ()
    position: tuple[str, ...] = ()
    length_unit: str = "mm"
    period: float | None = None


@dataclass(frozen=True)
class Log:
    """An evenly sampled record.

    Attributes:
        dt: sample period [s].
        command: (T, axes) [command unit].
        position: (T, axes) [m].
        words: what was done to the file's numbers, one line each.
    """

    dt: float
    command: Float[np.ndarray, "T axes"]
    position: Float[np.ndarray, "T axes"]
    words: tuple[str, ...]


def read_log(path: Path, axes: Sequence[str], columns: LogColumns) -> Log:
    """Commands and positions of a log.

    A gap, or a clock that starts again, splits the record: its longest even part is used, and that
    is said. Jitter of more than 1 % of a sample everywhere is refused.

    Raises:
        ValueError: the file cannot be read, a column is missing, time does not grow evenly, or a
            number is not finite; one line in the user's words.
    """
    table = read_table(path)
    time_name = columns.time or _first(table, TIME_WORDS, tuple(SECONDS))
    commands = _named(path, table, columns.command, axes, COMMAND_WORDS, "command", COMMAND_UNITS)
    positions = _named(path, table, columns.position, axes, POSITION_WORDS, "position", METRES)
    command = np.stack([_column(path, table, one) for one in commands], axis=1)
    metre = [METRES[_unit(one, METRES) or columns.length_unit] for one in positions]
    position = np.stack([_column(path, table, one) for one in positions], axis=1) * metre
    words = [
        f"{name}: command {u}, position {y}"
        for name, u, y in zip(axes, commands, positions, strict=True)
    ]
    if columns.period is not None:
        dt, keep = columns.period, slice(0, len(command))
    elif time_name is None:
        raise ValueError(
            f"{path}: has no column of time; name it with --time-column, or give --period-ms; "
            f"has {', '.join(table)}"
        )
    else:
        time = _column(path, table, time_name)
        stated = _unit(time_name, SECONDS)
        unit = stated or likely_unit(time)
        part = _even_part(path, time * SECONDS[unit])
        dt, keep = part.dt, part.rows
        words += [part.words] if part.words else []
        if stated is None and unit != "s":
            words.append(
                f"time: column {time_name} states no unit and is taken as {unit}, a sample every "
                f"{1e3 * dt:g} ms; if it is not, give --period-ms"
            )
    command, position = command[keep], position[keep]
    both = zip([*commands, *positions], [*command.T, *position.T], strict=True)
    for name, values in both:
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            row = (keep.start or 0) + bad[0] + 1
            raise ValueError(
                f"{path}: column {name} holds no number in row {row} behind the header"
            )
    return Log(dt, command, position, tuple(words))


def _even_part(path: Path, time: Float[np.ndarray, " T"]) -> EvenPart:
    try:
        return longest_even_part(time)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _named(
    path: Path,
    table: Table,
    given: Sequence[str],
    axes: Sequence[str],
    words: Sequence[str],
    what: str,
    units: Sequence[str] | dict,
) -> list[str]:
    """Names of one column for each axis."""
    if given:
        if len(given) != len(axes):
            raise ValueError(
                f"{what}-columns: needs {len(axes)} names, one per axis, received {len(given)}"
            )
        return [one.lower() for one in given]
    found = []
    for axis in axes:
        name = axis.lower()
        wanted = [f"{name}_{word}" for word in words] + [f"{word}_{name}" for word in words]
        column = _first(table, wanted, tuple(units))
        if column is None:
            raise ValueError(
                f"{path}: has no column {name}_{what}; name one per axis with --{what}-columns; "
                f"has {', '.join(table)}"
            )
        found.append(column)
    return found


def _first(table: Table, words: Sequence[str], units: Sequence[str]) -> str | None:
    for word in words:
        said = (end for unit in units for end in (f"_{unit}", f" [{unit}]", f" ({unit})"))
        for name in (word, *(f"{word}{end}" for end in said)):
            if name in table:
                return name
    return None


def _unit(name: str, units: dict[str, float]) -> str | None:
    """Unit at the end of a column's name."""
    found = re.search(r"(?:_([^\W_]+)|\[(\w+)\]|\((\w+)\))$", name.strip().lower())
    end = next((one for one in found.groups() if one), None) if found else None
    end = None if end is None else end.rsplit("_", 1)[-1]
    return end if end in units else None


def _column(path: Path, table: Table, name: str) -> np.ndarray:
    if name.lower() not in table:
        raise ValueError(f"{path}: has no column {name!r}; has {', '.join(table)}")
    return table[name.lower()]
