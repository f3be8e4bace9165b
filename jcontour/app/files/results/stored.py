"""Results of commands: frozen dataclasses that become JSON, and load back from it.

A field with a default is left out of the JSON while it has its default.
NaN and infinity become null; null in a field of type `float` is read as NaN.
"""

from pathlib import Path
from typing import Any, TypeVar

import cattrs
import numpy as np
from cattrs.errors import BaseValidationError
from cattrs.strategies import configure_union_passthrough

from jcontour.app.files.run_folder import RESULT, RunError, plain, read_json, write_json

T = TypeVar("T")
VERSION = 4  # of the fields of results: it grows when one is renamed or means something else
Weight = float | list[float] | None  # of one name: a number, one number per axis, or none
Scalar = bool | int | float | str | None


def to_json(result: Any) -> Any:
    """Lists, dicts, strings and numbers of a result, as JSON has them."""
    return plain(_converter.unstructure(result))


def from_json(values: Any, kind: type[T]) -> T:
    """Result of this kind from what `to_json` made of it."""
    try:
        return _converter.structure(values, kind)
    except BaseValidationError as error:
        raise ValueError("; ".join(cattrs.transform_error(error, "result"))) from None


def write_result(folder: Path, result: Any) -> Path:
    """Write the result of a run; it comes last, when all other files are there."""
    return write_json(folder / RESULT, versioned(result))


def versioned(result: Any) -> dict[str, Any]:
    """A result as JSON, with the version of its fields."""
    return {"version": VERSION, **to_json(result)}


def read_result(folder: Path, kind: type[T]) -> T:
    """Result of the run in a folder.

    Raises:
        RunError: there is none, or another version of the command wrote it.
    """
    values = read_json(folder, RESULT)
    if values.get("version") != VERSION:
        raise RunError(f"{folder}: its result is of another version of jcontour; run it again")
    try:
        return from_json(values, kind)
    except ValueError as error:
        reason = str(error).split(";")[0]
        raise RunError(
            f"{folder}: its result is not of this version's {kind.__name__} ({reason}); run it "
            "again"
        ) from None


def _number(value: Any, _: Any) -> float:
    if value is None:
        return float("nan")
    if isinstance(value, bool | str):
        raise TypeError(f"expected a number, received {value!r}")
    return float(value)


def _text(value: Any, kind: type[str]) -> str:
    if not isinstance(value, str):
        raise TypeError(f"expected a text, received {value!r}")
    return kind(value)  # of an enumeration of texts: its member


def _made() -> cattrs.Converter:
    converter = cattrs.Converter(omit_if_default=True)
    converter.register_structure_hook(float, _number)
    converter.register_structure_hook(str, _text)
    # arrays with jaxtyping's shapes, as Float[np.ndarray, "T 2"]; null becomes NaN
    converter.register_structure_hook_func(
        lambda kind: kind is np.ndarray or getattr(kind, "array_type", None) is np.ndarray,
        lambda value, _: np.asarray(value, float),
    )
    configure_union_passthrough(Scalar, converter)
    converter.register_structure_hook(Weight, lambda value, _: value)
    return converter


_converter = _made()
