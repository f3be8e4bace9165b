"""Checks of the fields of a file that a user wrote.

A fault is told in one line, in the user's words.
"""

import json
import math
from typing import Any

import numpy as np

METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6}  # units of length in files
LONGEST = 200  # characters of an error of others that is told
EXAMPLE = "`jcontour machine --example FILE` writes one"  # of a machine file
LARGEST = 1e12  # of any number: beyond it squares overflow somewhere


class MachineError(ValueError):
    """A machine file that cannot be used; one line: field, what was received, what is needed."""


def json_value(content: bytes) -> Any:
    """Value of a JSON text in UTF-8, with a byte order mark or without.

    Raises:
        ValueError: it is no JSON, or an object has a field twice.
    """
    try:
        return json.loads(content.decode("utf-8-sig"), object_pairs_hook=_fields)
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"is not JSON ({line(error)})") from None


def _fields(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for name, value in pairs:
        if name in fields:
            raise ValueError(f"the field {shown(name)} stands twice in one object")
        fields[name] = value
    return fields


def matrix(name: str, value: Any) -> np.ndarray:
    """Rows of equal length, finite numbers."""
    try:
        rows = np.array(value, dtype=float)
    except (ValueError, TypeError, OverflowError, RecursionError):
        raise MachineError(f"{name}: needs a matrix of numbers, received {shown(value)}") from None
    if rows.ndim != 2 or rows.size == 0:
        raise MachineError(
            f"{name}: needs a matrix, a list of rows of equal length, received shape {rows.shape}"
        )
    if isinstance(value, list) and any(
        isinstance(entry, (str, bool)) for row in value for entry in row
    ):
        raise MachineError(f"{name}: needs numbers, received text or true/false among them")
    if not np.isfinite(rows).all():
        raise MachineError(f"{name}: every entry needs to be finite, received NaN or inf")
    if np.abs(rows).max() > LARGEST:
        raise MachineError(
            f"{name}: needs entries of at most {LARGEST:g}, received {np.abs(rows).max():g}"
        )
    return rows


def number(name: str, value: Any, least: float = -LARGEST, above: float | None = None) -> float:
    """A finite number of at least `least`, and above `above` where that is given."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise MachineError(f"{name}: needs a number, received {shown(value)}")
    if LARGEST < value < math.inf:
        raise MachineError(f"{name}: needs to be at most {LARGEST:g}, received {shown(value)}")
    if not (abs(value) <= LARGEST and value >= least and (above is None or value > above)):
        bound = f"above {above:g}" if above is not None else f"of at least {least:g}"
        raise MachineError(f"{name}: needs a finite number {bound}, received {shown(value)}")
    return float(value)


def whole(name: str, value: Any, most: int) -> int:
    """A whole number of samples from 0 to `most`."""
    samples = number(name, value, least=0)
    if samples != int(samples) or samples > most:
        raise MachineError(
            f"{name}: needs a whole number of samples from 0 to {most}, received {samples:g}"
        )
    return int(samples)


def per_axis(name: str, value: Any, size: int, zero: bool = False) -> np.ndarray:
    """One positive number for every axis, given once or each; it may be `zero`."""
    values = value if isinstance(value, list) else [value] * size
    if len(values) != size:
        raise MachineError(f"{name}: needs one number or {size}, received {len(values)}")
    above = None if zero else 0.0
    return np.array([number(name, entry, least=0.0, above=above) for entry in values])


def one_or_each(name: str, value: Any, size: int, zero: bool = False) -> float | np.ndarray:
    """A positive number where it is that of every axis, else one for each; it may be `zero`."""
    values = per_axis(name, value, size, zero)
    return float(values[0]) if (values == values[0]).all() else values


def axis_names(value: Any, count: int) -> tuple[str, ...]:
    """Names of the axes; X, Y, Z when none are given."""
    if value is None:
        return ("X", "Y", "Z")[:count]
    if (
        not isinstance(value, list)
        or len(value) != count
        or len({str(entry) for entry in value}) != count
    ):
        raise MachineError(
            f"axes: needs {count} different names, one per output, received {shown(value)}"
        )
    return tuple(text("axes", entry) for entry in value)


def text(name: str, value: Any) -> str:
    """A short printable text."""
    if not isinstance(value, str) or not value.isprintable() or not 0 < len(value) <= 80:
        raise MachineError(
            f"{name}: needs a text of 1 to 80 printable characters, received {shown(value)}"
        )
    return value


def mapping(name: str, value: Any, allowed: set[str]) -> dict[str, Any]:
    """An object with no other fields than the allowed ones."""
    if not isinstance(value, dict):
        raise MachineError(
            f"{name}: needs an object with {', '.join(sorted(allowed))}, received {shown(value)}"
        )
    known(name, value, allowed)
    return value


def known(name: str, fields: dict[str, Any], allowed: set[str]) -> None:
    """Raise unless every field is one of the allowed ones."""
    unknown = sorted(set(fields) - allowed)
    if unknown:
        raise MachineError(
            f"{name}: there is no field {shown(unknown[0])}; known are {', '.join(sorted(allowed))}"
        )


def shown(value: Any) -> str:
    """A value as a message shows it: short."""
    try:
        words = repr(value)
    except (ValueError, RecursionError):  # Python refuses to print integers of thousands of digits
        words = type(value).__name__
    return words if len(words) <= 60 else words[:57] + "..."


def line(error: BaseException) -> str:
    """An error in one line."""
    words = " ".join(str(error).split())
    if len(words) > LONGEST:  # what is left ends with a whole word
        words = words[: LONGEST + 1].rpartition(" ")[0] + " ..."
    return words or type(error).__name__
