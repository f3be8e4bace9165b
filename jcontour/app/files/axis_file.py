"""Fields of the file of flexible axes.

`jcontour/app/machines/thesis-axis.json` is one, and `jcontour.plants.flexible_axis` has the
equations.
"""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from jcontour.app.files.checks import MachineError
from jcontour.app.files.schema import (
    Note,
    NotNegative,
    Number,
    OneOrEach,
    Positive,
    Schema,
    Text,
    axis_names,
    per_axis,
)
from jcontour.plants.flexible_axis.axis import AxisParameters
from jcontour.plants.friction import Friction

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
