"""Fields of the files of linear machines and of flexible axes.

`example.json` beside the machines is a linear one; `jcontour machine --example FILE` writes it.
`thesis-axis.json` is a flexible axis, and `jcontour.plants.flexible_axis` has the equations.
`python -m jcontour.app.files.machine_file` writes the page of the fields, and a JSON Schema for
editors.
"""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, TypeAdapter, model_validator

from jcontour.app.files.checks import MachineError
from jcontour.app.files.schema import (
    Matrix,
    Note,
    NotNegative,
    Number,
    OneOrEach,
    Positive,
    Row,
    Schema,
    Text,
    Unit,
    Whole,
    axis_names,
    per_axis,
)
from jcontour.plants.flexible_axis.axis import AxisParameters
from jcontour.plants.friction import Friction

MOST_DELAY = 50  # samples


Rows = Annotated[list[list[Number]], Field(title="lists, one per axis")]


class LimitFields(Schema):
    """Greatest magnitudes."""

    speed: OneOrEach[Positive] | None = None
    """[length/s]"""
    acceleration: OneOrEach[Positive] | None = None
    """[length/s^2]; a motion asks for half of it"""
    jerk: OneOrEach[Positive] | None = None
    """[length/s^3] of a motion; when not given, the acceleration builds up in 20 ms"""
    control: OneOrEach[Positive] | None = None
    """[control unit]"""
    increment: OneOrEach[Positive] | None = None
    """of the control [control unit per sample]"""


class ResponseFields(Schema):
    """How far off the frequency response may be; tuned loops stay stable for twice as much."""

    hertz: Row
    """rising frequencies [Hz], up to half of the sample rate"""
    relative: Matrix
    """abs(G_true / G - 1) at these frequencies, one row per axis"""


class LinesFields(Schema):
    """G_true / G - 1 at some frequencies."""

    hertz: Rows
    """frequencies [Hz], one list per axis, as in the other fields"""
    real: Rows
    """real parts of G_true / G - 1"""
    imaginary: Rows
    """imaginary parts"""
    half_width: Rows
    """of their 95 % intervals"""


class UncertaintyFields(Schema):
    """What is not known about a machine."""

    gain: Annotated[NotNegative, Field(lt=1)] = 0.0
    """fraction to which each input gain is known; of a drive that takes a position, for moves from
    where the part begins"""
    delay: Annotated[Whole, Field(le=MOST_DELAY)] = 0
    """most samples of delay that the model does not have"""
    response: ResponseFields | None = None
    """how far off the frequency response may be"""
    measured: LinesFields | None = None
    """the response that was measured; a loop keeps the limit on its peak sensitivity with it"""
    other_amplitudes: LinesFields | None = None
    """with less and less of the stiffness between a measured motor and its load, as in backlash,
    and with dry friction that damps the load; a loop keeps twice that limit"""


class LinearMachineFile(Schema):
    """A machine x(k+1) = A x + B u, y = C x of two or three axes.

    Every axis has one input and one output of its own: the tool starts in steady motion.
    """

    name: Text | None = None
    """for tables; the file's name when not given"""
    length_unit: Unit = "m"
    """of y, of the limits, of the encoders' counts and of their noise"""
    control_unit: Text = "control unit"
    """for tables and figures"""
    axes: list[Text] | None = None
    """names, one per output; X, Y, Z when not given"""
    A: Matrix
    """of the state"""
    B: Matrix
    """of the control"""
    C: Matrix
    """of the position of the tool point [length]"""
    dt: Positive
    """sample period [s]"""
    limits: LimitFields = LimitFields()
    """greatest magnitudes"""
    known_delay: Annotated[Whole, Field(le=MOST_DELAY)] = 0
    """samples between a control and its effect that A and B do not contain; goes into the model"""
    uncertainty: UncertaintyFields | None = None
    """what is not known; when not given, gains known to 10 % (of a drive that takes a position:
    exactly) and a sample of delay"""
    encoder_resolution: OneOrEach[Positive] | None = None
    """[length] per count; 0.8 um when not given"""
    encoder_noise: OneOrEach[NotNegative] = 0.0
    """[length] standard deviation of the noise of the encoders beside their rounding"""
    control_noise: Positive | None = None
    """[control unit] standard deviation that the Kalman filter assumes on each control; when not
    given, 5 % of the control limit, or 0.1: about what an input gain 10 % off does"""
    friction: OneOrEach[NotNegative] | None = 0.0
    """[control unit] that dry friction takes, null where it is not known; it is in the runs, it is
    fed forward, and what is proven takes it as a force"""
    friction_known_to: OneOrEach[Annotated[NotNegative, Field(lt=1)]] = 0.1
    """fraction to which it is known"""
    stribeck_friction: OneOrEach[NotNegative] = 0.0
    """[control unit] that it takes more at rest; in the runs and in what is proven"""
    stribeck_speed: OneOrEach[Positive] | None = None
    """[length/s] at which half of that is left; needed with it"""
    backlash: OneOrEach[NotNegative] = 0.0
    """[length] gap between the motor, where the encoders are, and the tool; it is in the runs, and
    --backlash compensates it"""
    note: Note | None = None
    """repeated by `simulate`, `tune` and `machine`"""


class StatedFields(Schema):
    """What a Python file states beside its plant, as a machine file does; lengths in metres."""

    uncertainty: UncertaintyFields | None = None
    """what is not known"""
    limits: LimitFields = LimitFields()
    """greatest magnitudes"""
    control_unit: Text = "control unit"
    """for tables and figures"""


NOTHING_STATED = StatedFields()
KIND = "flexible-axis"
ENCODER_RESOLUTION = 1e-6  # [m] usual for a linear encoder on a direct drive
MOST_AXES, MOST_HARMONICS, MOST_NOTES = 3, 64, 100
NUMBERS = (
    "motor_mass",
    "tool_mass",
    "stiffness",
    "damping",
    "force_constant",
    "pole_pitch",
)
COGGING = ("cogging_sine", "cogging_cosine")


def _form(value: Any) -> str:
    return "each" if isinstance(value, list) and value and isinstance(value[0], list) else "one"


Waves = Annotated[list[Number], Field(max_length=MOST_HARMONICS)]
Harmonics = Annotated[
    Annotated[Waves, Tag("one")] | Annotated[list[Waves], Tag("each")],
    Discriminator(_form),
    Field(title="list, or one list per axis"),
]


class FrictionFields(Schema):
    """Friction of the motors' guide ways."""

    coulomb: OneOrEach[NotNegative]
    """f_c [N]"""
    stribeck: OneOrEach[NotNegative]
    """f_s [N]"""
    stribeck_speed: OneOrEach[Positive]
    """v_s [m/s]"""
    viscous: OneOrEach[NotNegative]
    """b_v [N s/m]"""


class FlexibleAxisFile(Schema):
    """One flexible axis, or several side by side; SI units."""

    kind: Literal["flexible-axis"]
    """the kind of machine"""
    name: Text | None = None
    """for tables; the file's name when not given"""
    axes: list[Text] | None = None
    """names, one per axis; X, Y, Z when not given"""
    dt: Positive
    """sample period of the controller [s]"""
    motor_mass: OneOrEach[Positive]
    """M_m [kg]"""
    tool_mass: OneOrEach[Positive]
    """M_e [kg]"""
    stiffness: OneOrEach[NotNegative]
    """k_s [N/m]"""
    damping: OneOrEach[NotNegative]
    """c_s [N s/m]"""
    force_constant: OneOrEach[Positive]
    """k_t [N/A]"""
    pole_pitch: OneOrEach[Positive]
    """tau [m]"""
    friction: FrictionFields
    """of the motors' guide ways"""
    cogging_sine: Harmonics
    """S_j [N] over the harmonics; [] for none"""
    cogging_cosine: Harmonics
    """C_j [N], as many"""
    encoder_resolution: OneOrEach[Positive] = ENCODER_RESOLUTION
    """[m] per count of the motors' encoders"""
    current_limit: OneOrEach[Positive] | None = None
    """of the motors [A]"""
    notes: Annotated[list[Note], Field(max_length=MOST_NOTES, title="list of texts")] = []
    """what the numbers are not good for"""

    @model_validator(mode="after")
    def _fits(self) -> "FlexibleAxisFile":
        """As many numbers as axes, harmonics of a sine as of a cosine."""
        if not 1 <= self.count <= MOST_AXES:
            raise ValueError(f"axes: needs one to {MOST_AXES} axes, received {self.count}")
        axis_names(self.axes, self.count)
        others = {"encoder_resolution": self.encoder_resolution}
        if self.current_limit is not None:
            others["current_limit"] = self.current_limit
        for name, value in (self._numbers | others).items():
            per_axis(name, value, self.count)
        sine, cosine = (self._harmonics(name).shape[1] for name in COGGING)
        if sine != cosine:
            raise ValueError(f"cogging_cosine: needs as many harmonics as cogging_sine, {sine}")
        return self

    @property
    def count(self) -> int:
        """Axes: as many as there are names, or numbers in the longest list."""
        if self.axes is not None:
            return len(self.axes)
        lists = [value for value in self._numbers.values() if isinstance(value, list)]
        lists += [rows for name in COGGING if _form(rows := getattr(self, name)) == "each"]
        return max(map(len, lists), default=1)

    @property
    def parameters(self) -> AxisParameters:
        """Of the plant, one number or row for each axis."""
        numbers = {key: per_axis(key, value, self.count) for key, value in self._numbers.items()}
        friction = {key: numbers.pop(f"friction.{key}") for key in FrictionFields.model_fields}
        cogging = {name: self._harmonics(name) for name in COGGING}
        return AxisParameters(friction=Friction(**friction), **numbers, **cogging)

    @property
    def _numbers(self) -> dict[str, float | list[float]]:
        """What there is one of for all axes, or one for each."""
        friction = {f"friction.{key}": value for key, value in self.friction}
        return {key: getattr(self, key) for key in NUMBERS} | friction

    def _harmonics(self, name: str) -> np.ndarray:
        """(m, P) amplitudes [N]."""
        value = getattr(self, name)
        rows = value if _form(value) == "each" else [value] * self.count
        if len(rows) != self.count or len({len(row) for row in rows}) > 1:
            raise MachineError(
                f"{name}: needs one list of harmonics, or {self.count} of equal length"
            )
        return np.array(rows, float).reshape(self.count, -1)


FOLDER = Path(__file__).parents[1] / "machines"
PAGE = FOLDER.parents[2] / "experiments" / "docs" / "reference" / "machine-file.md"
SCHEMA = FOLDER / "machine-file.schema.json"
TEXT = """# Machine file

JSON. With `machine-file.schema.json` of `jcontour/app/machines` an editor completes it.

{linear}

## A flexible axis

{flexible}
"""


def documents() -> dict[Path, str]:
    """Text of both files."""
    schema = TypeAdapter(LinearMachineFile | FlexibleAxisFile).json_schema()
    page = TEXT.format(linear=_section(LinearMachineFile), flexible=_section(FlexibleAxisFile))
    return {PAGE: page, SCHEMA: json.dumps(schema) + "\n"}


def _section(kind: type[Schema]) -> str:
    schema = kind.model_json_schema()
    head = ["| field | value | default | |", "|---|---|---|---|"]
    return "\n".join([schema["description"], "", *head, *_rows(schema, schema["$defs"], "")])


def _rows(schema: dict[str, Any], nested: dict[str, Any], outer: str) -> list[str]:
    """A row of the table for each field, those of an object after it."""
    rows = []
    for name, field in schema["properties"].items():
        form = field.get("anyOf", [field])[0]
        inner = nested.get(form.get("$ref", "").rpartition("/")[2])
        value = f"`{form['const']}`" if "const" in form else form.get("title", "list of texts")
        default = "" if inner or field.get("default") is None else f"`{field['default']}`"
        if name in schema.get("required", ()):
            default = "required"
        words = " ".join(field["description"].split())
        shown = "object" if inner else value
        rows.append(f"| `{outer}{name}` | {shown} | {default} | {words} |")
        if inner:
            rows += _rows(inner, nested, f"{outer}{name}.")
    return rows


if __name__ == "__main__":
    for path, text in documents().items():
        path.write_text(text)
