"""Records of a machine: commands and positions of its axes over time, from a log.

Columns are found by their names, x_command and x_position for the axis X beside `time` [s], or by
flags that name them. A name may end in its unit: time_ms, x_command_V, x_position_um, Time [ms],
x_position_deg. An angle is kept in rad where a length is in m.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour.app.files.checks import ANGLE, METRES, RADIANS, named
from jcontour.app.files.clock import SECONDS, likely_unit, longest_even_part, resampled
from jcontour.app.files.log_table import Table, finite, read_table

LENGTHS = METRES | {"inch": 0.0254} | RADIANS
COUNTS = "counts"  # of which --length-unit states the metres
RATES = tuple(f"{unit}{per}" for unit in LENGTHS for per in ("/s", "_per_s"))
COMMAND_UNITS = (*LENGTHS, *RATES, "v", "mv", "a", "ma", "n", "nm", "rpm", "%", "percent", "counts")
COMMAND_WORDS = ("command", "control", "u", "cmd", "torque", "velocity_command", "speed_command")
ASKED_WORDS = ("command", "cmd", "reference", "ref", "target", "setpoint", "demand", "desired")
POSITION_WORDS = ("position", "pos", "y", "q", "actual", "measured")
LISTED = 40  # columns that a refusal names
HAL = {"command": "cmd", "position": "fb"}  # pins of LinuxCNC's joints
PERIODS = 1e-6, 0.5  # [s] of logs, at least and at most
TIME_WORDS = ("time", "t", "timestamp")


@dataclass(frozen=True)
class LogColumns:
    """Where a log holds what."""

    time: str | None = None  # name of the column; found by itself when None
    # command, position: names by axis; found by themselves when empty
    command: tuple[str, ...] = ()
    position: tuple[str, ...] = ()
    # of the positions, where their names do not say; a number: the metres of one, as of a count
    length_unit: str | float = "mm"
    period: float | None = None  # [s]; a column of time is then not read
    asked: bool = False  # whether the commands are positions too: they become [m] alike


@dataclass(frozen=True)
class Log:
    """An evenly sampled record."""

    dt: float  # sample period [s]
    command: Float[np.ndarray, "T axes"]  # (T, axes) [command unit]; [m] where they are positions
    position: Float[np.ndarray, "T axes"]  # (T, axes) [m]
    words: tuple[str, ...]  # what was done to the file's numbers, one line each
    angles: tuple[bool, ...] = ()  # which axes turn: their positions are in rad


def read_log(path: Path, axes: Sequence[str], columns: LogColumns) -> Log:
    """Commands and positions of a log.

    A gap, or a clock that starts again, splits the record: its longest part is used, and that is
    said. Stamps that jitter are interpolated to even ones, with their largest deviation said.
    """
    table, lengths = read_table(path), (*LENGTHS, COUNTS)
    called, in_units = (ASKED_WORDS, lengths) if columns.asked else (COMMAND_WORDS, COMMAND_UNITS)
    commands = _named(path, table, columns.command, axes, called, "command", in_units)
    positions = _named(path, table, columns.position, axes, POSITION_WORDS, "position", lengths)
    units = [_unit(one, lengths) or columns.length_unit for one in positions]
    signals = np.stack([_column(path, table, one) for one in [*commands, *positions]], axis=1)
    words = [
        f"{name}: command {u}, position {y}" + (f", an angle: {ANGLE}" if unit in RADIANS else "")
        for name, u, y, unit in zip(axes, commands, positions, units, strict=True)
    ]
    stamps, said = _stamps(path, table, columns)
    words += said
    if stamps is None:
        assert columns.period is not None
        dt, keep = columns.period, slice(0, len(signals))
    else:
        if len(stamps) != len(signals):
            raise ValueError(f"{path}: time has {len(stamps)} rows, the signals {len(signals)}")
        with named(path):
            part = longest_even_part(stamps)
        dt, keep = part.dt, part.rows
        words += [part.words] if part.words else []
    if not PERIODS[0] <= dt <= PERIODS[1]:
        raise ValueError(
            f"{path}: a sample every {1e3 * dt:g} ms is no period of a drive; is the unit of its "
            "column of time right? Call it time_ms or time_us, or give --period-ms"
        )
    signals = signals[keep]
    for name, values in zip([*commands, *positions], signals.T, strict=True):
        finite(path, name, values, keep.start or 0)
    if stamps is not None:
        signals = resampled(stamps[keep], dt, signals)
    command, position = np.split(signals, 2, axis=1)
    if columns.asked:
        command = command * [_metres(path, one, columns) for one in commands]
    position = position * [_metres(path, one, columns) for one in positions]
    return Log(dt, command, position, tuple(words), tuple(unit in RADIANS for unit in units))


def read_step(path: Path, length_unit: str) -> Log:
    """A log of one axis with the columns time, control and position, by name or in this order."""
    plain = list(read_table(path)) == ["1", "2", "3"]
    time, control, position = ("1", "2", "3") if plain else ("time", "control", "position")
    return read_log(path, ("step",), LogColumns(time, (control,), (position,), length_unit))


def _stamps(
    path: Path, table: Table, columns: LogColumns
) -> tuple[Float[np.ndarray, " T"] | None, list[str]]:
    """Times of the samples [s], and how they were read; None where a period is given."""
    name = columns.time or _first(table, TIME_WORDS, tuple(SECONDS))
    if columns.period is not None:
        if name is None:
            return None, []
        return None, [f"time: --period-ms {1e3 * columns.period:g} counts, column {name} does not"]
    if name is None:
        raise ValueError(
            f"{path}: has no column of time; name it with --time-column, or give --period-ms; "
            f"has {_listed(table)}"
        )
    time = _column(path, table, name)
    stated = _unit(name, SECONDS)
    unit = stated or likely_unit(time)
    if stated is not None or unit == "s":
        return time * SECONDS[unit], []
    period = 1e3 * SECONDS[unit] * float(np.median(np.diff(time)))
    return time * SECONDS[unit], [
        f"time: column {name} states no unit and is taken as {unit}, a sample every "
        f"{period:g} ms; if it is not, give --period-ms"
    ]


def _named(
    path: Path,
    table: Table,
    given: Sequence[str],
    axes: Sequence[str],
    words: Sequence[str],
    what: str,
    units: Sequence[str],
) -> list[str]:
    """Names of one column for each axis."""
    if given:
        if len(given) != len(axes):
            raise ValueError(
                f"{what}-columns: needs {len(axes)} names, one per axis, received {len(given)}"
            )
        return [one.lower() for one in given]
    columns = []
    for axis in axes:
        name = axis.lower()
        wanted = [f"{name}_{word}" for word in words] + [f"{word}_{name}" for word in words]
        wanted.append(f"joint.{len(columns)}.motor-pos-{HAL[what]}")
        column = _first(table, wanted, units)
        if column is None:
            raise ValueError(
                f"{path}: has no column {name}_{what}; name one per axis with --{what}-columns; "
                f"has {_listed(table)}"
            )
        columns.append(column)
    return columns


def _first(table: Table, words: Sequence[str], units: Sequence[str]) -> str | None:
    for word in words:
        said = (end for unit in units for end in (f"_{unit}", f" [{unit}]", f" ({unit})"))
        for name in (word, *(f"{word}{end}" for end in said)):
            if name in table:
                return name
    return None


def _unit(name: str, units: Collection[str]) -> str | None:
    """Unit at the end of a column's name, or before the number of a matrix's column."""
    name = re.sub(r"_\d+$", "", name.strip().lower())
    match = re.search(r"(?:_([^\W_]+)|\[(\w+)\]|\((\w+)\))$", name)
    end = next((one for one in match.groups() if one), None) if match else None
    end = None if end is None else end.rsplit("_", 1)[-1]
    return end if end in units else None


def _metres(path: Path, name: str, columns: LogColumns) -> float:
    """Metres, or radians, of one in a column of positions."""
    unit, other = _unit(name, (*LENGTHS, COUNTS)), columns.length_unit
    if unit == COUNTS and isinstance(other, str):
        raise ValueError(f"{path}: {name}: give the metres of a count, as --length-unit 1e-6")
    known = other if unit in (None, COUNTS) else unit
    return LENGTHS[known] if isinstance(known, str) else known


def _column(path: Path, table: Table, name: str) -> np.ndarray:
    """A column by its name, or by the last part of it, as `pos_1` of rec.pos_1."""
    ends = [one for one in table if one.endswith(f".{name.lower()}")]
    column = name.lower() if name.lower() in table or len(ends) != 1 else ends[0]
    if column not in table:
        raise ValueError(f"{path}: has no column of numbers {name!r}; has {_listed(table)}")
    return table[column]


def _listed(table: Table) -> str:
    """Names of the first columns."""
    more = f" and {len(table) - LISTED} more" if len(table) > LISTED else ""
    return ", ".join(list(table)[:LISTED]) + more
