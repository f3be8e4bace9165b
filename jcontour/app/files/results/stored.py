"""Results of commands: frozen dataclasses that become JSON, and load back from it.

A field with a default is left out of the JSON while it has its default.
`field(metadata=BESIDE_OTHERS)` puts the entries of a dict, as weights by name, beside the other
fields.
NaN and infinity become null; null in a field of type `float` is read as NaN.
"""

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import cattrs
import numpy as np
from cattrs.errors import BaseValidationError
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn
from cattrs.strategies import configure_union_passthrough

from jcontour.app.files.run_folder import RESULT, RunError, plain, read_json, write_json

T = TypeVar("T")
VERSION = 2  # of the fields of results: it grows when one is renamed or means something else
Weight = float | list[float] | None  # of one name: a number, one number per axis, or none
Scalar = bool | int | float | str | None
_BESIDE = "entries stand beside the other fields in JSON"
BESIDE_OTHERS = {_BESIDE: True}  # metadata of a dict field


def to_json(result: Any) -> Any:
    """Lists, dicts, strings and numbers of a result, as JSON has them."""
    return plain(_converter.unstructure(result))


def from_json(values: Any, kind: type[T]) -> T:
    """Result of this kind from what `to_json` made of it.

    Raises:
        ValueError: a field is missing, or its value is of another type.
    """
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
            f"{folder}: its result is not of this version's {kind.__name__} ({reason})"
        ) from None


def _to_dict(kind: Any) -> Any:
    write = make_dict_unstructure_fn(kind, _converter, _cattrs_omit_if_default=True)
    spread = _beside(kind)
    if not spread:
        return write

    def write_beside(result: Any) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for name, value in write(result).items():
            values |= value if name in spread else {name: value}
        return values

    return write_beside


def _from_dict(kind: Any) -> Any:
    read = make_dict_structure_fn(kind, _converter)
    spread = _beside(kind)
    if not spread:
        return read
    (gathered,) = spread
    known = {one.name for one in fields(kind)} - {gathered}

    def read_beside(values: dict[str, Any], of: Any) -> Any:
        own = {name: value for name, value in values.items() if name in known}
        others = {name: value for name, value in values.items() if name not in known}
        return read({**own, gathered: others}, of)

    return read_beside


def _beside(kind: Any) -> list[str]:
    return [one.name for one in fields(kind) if one.metadata.get(_BESIDE)]


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


def _is_array_with_shape(kind: Any) -> bool:
    """Whether a type is jaxtyping's, as Float[np.ndarray, "T 2"]."""
    return getattr(kind, "array_type", None) is np.ndarray


def _array(value: Any, _: Any) -> np.ndarray:
    return np.asarray(value, float)  # null becomes NaN


def _as_it_is(value: Any, _: Any) -> Any:
    return value


def _made() -> cattrs.Converter:
    converter = cattrs.Converter()
    converter.register_unstructure_hook_factory(is_dataclass, _to_dict)
    converter.register_structure_hook_factory(is_dataclass, _from_dict)
    converter.register_structure_hook(float, _number)
    converter.register_structure_hook(str, _text)
    converter.register_structure_hook(np.ndarray, _array)
    converter.register_structure_hook_func(_is_array_with_shape, _array)
    configure_union_passthrough(Scalar, converter)
    converter.register_structure_hook(Weight, _as_it_is)
    return converter


_converter = _made()
