"""Schemas of the JSON files that users write: the checks of their fields, and what documents them.

A fault is one line that names its field. Lengths of lists that depend on the number of axes are
checked by `per_axis` and `axis_names`.
"""

import re
from functools import partial
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
    ValidationError,
    model_validator,
)

from jcontour.app.files.checks import LARGEST, MachineError, line, shown


class Schema(BaseModel):
    """An object with no other fields than its own; a docstring below a field documents it."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _is_known(cls, given: Any) -> Any:
        known = sorted(cls.model_fields)
        if not isinstance(given, (dict, cls)):
            raise ValueError(f"needs an object with {', '.join(known)}, received {shown(given)}")
        unknown = [] if isinstance(given, cls) else [key for key in given if key not in known]
        if unknown:
            raise ValueError(f"there is no field {shown(unknown[0])}; known are {', '.join(known)}")
        return given


Kind = TypeVar("Kind", bound=Schema)
Entry = TypeVar("Entry")


def read(kind: type[Kind], given: Any, name: str = "") -> Kind:
    """The object of this schema; `name` is the field that it stands in.

    Raises:
        MachineError: a field is missing, unknown or wrong.
    """
    try:
        return kind.model_validate(given)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        place = [name, *(part for part in fault["loc"] if isinstance(part, str))]
        field = ".".join(part for part in place if part and part not in FORMS)
        raise MachineError(f"{field}: {_words(fault)}" if field else _words(fault)) from None


def _words(fault: Any) -> str:
    """A fault as the library reports it, in the words of the other messages."""
    if fault["type"] == "value_error":
        return line(fault["ctx"]["error"])
    if fault["type"] == "missing":
        return "missing"
    needed = re.sub(r"^\w+ should (be|have)", r"needs to \1", fault["msg"])
    return f"{needed}, received {shown(fault['input'])}"


FORMS = ("one", "each")  # of a value that is given once, or for every axis


def _listed(value: Any) -> Any:
    """Arrays of a user's Python file as lists."""
    return value.tolist() if isinstance(value, np.ndarray) else value


def _whole(value: Any) -> Any:
    """2.0 counts samples as well as 2 does."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError(f"needs printable characters, received {shown(text)}")
    return text


def _rectangular(rows: list[list[float]]) -> list[list[float]]:
    if len({len(row) for row in rows}) > 1:
        raise ValueError("needs a matrix, a list of rows of equal length")
    return rows


Number = Annotated[
    float, Field(strict=True, ge=-LARGEST, le=LARGEST, allow_inf_nan=False, title="number")
]
Positive = Annotated[Number, Field(gt=0, title="number above 0")]
NotNegative = Annotated[Number, Field(ge=0, title="number of at least 0")]
Whole = Annotated[int, Field(strict=True, ge=0, title="whole number"), BeforeValidator(_whole)]
PRINTABLE, TITLE = AfterValidator(_printable), Field(title="text")
characters = partial(StringConstraints, strict=True, min_length=1)
Text = Annotated[str, characters(max_length=80), PRINTABLE, TITLE]
Note = Annotated[str, characters(max_length=1000), PRINTABLE, TITLE]
Unit = Annotated[Literal["m", "mm", "um"], Field(title="`m`, `mm` or `um`")]
Row = Annotated[list[Number], BeforeValidator(_listed), Field(min_length=1, title="list")]
Matrix = Annotated[
    list[Row],
    BeforeValidator(_listed),
    Field(min_length=1, title="matrix"),
    AfterValidator(_rectangular),
]
OneOrEach = Annotated[
    Annotated[Entry, Tag("one")] | Annotated[list[Entry], Tag("each")],
    Discriminator(lambda value: "each" if isinstance(value, (list, tuple, np.ndarray)) else "one"),
    Field(title="number, or one per axis"),
]


def per_axis(name: str, value: float | list[float], count: int) -> np.ndarray:
    """One number for every axis, given once or each.

    Raises:
        MachineError: there are more or fewer.
    """
    values = value if isinstance(value, list) else [value] * count
    if len(values) != count:
        raise MachineError(f"{name}: needs one number or {count}, received {len(values)}")
    return np.array(values)


def one_or_each(name: str, value: float | list[float], count: int) -> float | np.ndarray:
    """A number where it is that of every axis, else one for each.

    Raises:
        MachineError: as `per_axis`.
    """
    values = per_axis(name, value, count)
    return float(values[0]) if (values == values[0]).all() else values


def axis_names(names: list[str] | None, count: int) -> tuple[str, ...]:
    """Names of the axes; X, Y, Z when none are given.

    Raises:
        MachineError: there are more or fewer, or two are the same.
    """
    names = ["X", "Y", "Z"][:count] if names is None else names
    if len(set(names)) != len(names) or len(names) != count:
        raise MachineError(f"axes: needs {count} different names, received {', '.join(names)}")
    return tuple(names)
