"""Faults of a file that a user wrote, each reported in one line."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from math import pi
from pathlib import Path
from typing import Any

from jcontour._regular_files import content_of

METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6}  # units of length in files
RADIANS = {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180, "rev": 2 * pi}  # and of angles
ANGLE = "1 rad stands where tables have 1 m, as at a radius of 1 m"
LONGEST = 200  # characters of an error of others that is printed
EXAMPLE = "`jcontour machine --example FILE` writes one"  # of a machine file
LARGEST = 1e12  # of any number: beyond it squares overflow somewhere


class MachineError(ValueError):
    """A file that cannot be used; one line: field, what was received, what is needed."""


@contextmanager
def named(what: object, kind: type[ValueError] = ValueError) -> Iterator[None]:
    """Faults of the block as of one kind, each with what it is a fault of, where it lacks that."""
    try:
        yield
    except ValueError as error:
        text = str(error)
        raise kind(text if str(what) in text else f"{what}: {text}") from None


def bytes_of(path: Path, most: int) -> bytes:
    """Content of a file that a user names, of so many bytes at most.

    Raises:
        MachineError: it cannot be read.
    """
    try:
        return content_of(path, most)
    except OSError as error:
        raise MachineError(f"{path}: cannot be read ({error.strerror or error})") from None


def json_value(content: bytes) -> Any:
    """Value of a JSON text in UTF-8, with a byte order mark or without."""
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
