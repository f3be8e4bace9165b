"""Axis files: a flexible axis as `jcontour identify` writes it and the commands that tune read it.

A JSON object, SI units; what is marked * is one number, or a list with one for each axis:

    kind                 "flexible-axis"
    name                 optional
    axes                 names, one per axis; X, Y, Z when not given
    dt                   sample period of the controller [s]
    motor_mass*          M_m [kg]
    tool_mass*           M_e [kg]
    stiffness*           k_s [N/m]
    damping*             c_s [N s/m]
    force_constant*      k_t [N/A]
    pole_pitch*          tau [m]
    friction             coulomb* f_c [N], stribeck* f_s [N], stribeck_speed* v_s [m/s], viscous*
    b_v [N s/m] cogging_sine         S_j [N]: a list over the harmonics, or a list of such lists,
    one for each axis; [] for none cogging_cosine       C_j [N]: likewise
    encoder_resolution*  [m] per count of the motor's encoder; 1 um when not given
    current_limit*       optional [A]
    electrical           optional: resistance* R [Ohm], inductance* L [H], back_emf* k_e [V s/m]
    notes                optional list of texts: what the numbers are not good for

`experiments/machines/thesis-axis.json` is one, and `jcontour.plants.flexible_axis` has the
equations.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.files import checks
from experiments.files.checks import MachineError
from experiments.files.run_folder import write_json
from jcontour.plants.flexible_axis.axis import AxisParameters
from jcontour.plants.friction import Friction

KIND = "flexible-axis"
ENCODER_RESOLUTION = 1e-6  # [m] usual for a linear encoder on a direct drive
MOST_AXES, MOST_HARMONICS, MOST_NOTES = 3, 64, 100
POSITIVE = ("motor_mass", "tool_mass", "force_constant", "pole_pitch")
NUMBERS = (*POSITIVE, "stiffness", "damping")
FRICTION = ("coulomb", "stribeck", "stribeck_speed", "viscous")
ELECTRICAL = ("resistance", "inductance", "back_emf")
REQUIRED = ("dt", *NUMBERS, "friction", "cogging_sine", "cogging_cosine")
FIELDS = {
    "kind",
    "name",
    "axes",
    *REQUIRED,
    "encoder_resolution",
    "current_limit",
    "electrical",
    "notes",
}


class Electrical(NamedTuple):
    """Electrical parameters of the motor of every axis (m,): R [Ohm], L [H], k_e [V s/m]."""

    resistance: np.ndarray
    inductance: np.ndarray
    back_emf: np.ndarray


@dataclass(frozen=True)
class AxisFile:
    """A flexible axis, or several side by side, as a file holds it.

    Attributes:
        parameters: of the plant.
        dt: sample period of the controller [s].
        axes: names.
        encoder_resolution: [m], of all axes or of each (m,).
        current_limit: (m,) [A], or None.
        electrical: of the motors, or None.
        notes: what the numbers are not good for.
    """

    name: str
    parameters: AxisParameters
    dt: float
    axes: tuple[str, ...]
    encoder_resolution: float | np.ndarray = ENCODER_RESOLUTION
    current_limit: np.ndarray | None = None
    electrical: Electrical | None = None
    notes: tuple[str, ...] = ()


def is_axis(fields: dict[str, Any]) -> bool:
    """Whether the fields of a JSON object are meant to be a flexible axis."""
    return fields.get("kind") == KIND


def axis_from(fields: Any, name: str = "axis") -> AxisFile:
    """The axis of the fields of a JSON object.

    Raises:
        MachineError: a field is missing, unknown or wrong.
    """
    fields = checks.mapping("file", fields, FIELDS)
    if not is_axis(fields):
        raise MachineError(f"kind: needs {KIND!r}, received {checks.shown(fields.get('kind'))}")
    _all_there("", fields, REQUIRED)
    axes = _count(fields)
    values = {key: _per_axis(key, fields[key], axes, positive=key in POSITIVE) for key in NUMBERS}
    friction = checks.mapping("friction", fields["friction"], set(FRICTION))
    _all_there("friction.", friction, FRICTION)
    rubbing = {
        key: _per_axis(f"friction.{key}", friction[key], axes, positive=key == "stribeck_speed")
        for key in FRICTION
    }
    cogging = {
        key: _harmonics(key, fields[key], axes) for key in ("cogging_sine", "cogging_cosine")
    }
    if len({rows.shape for rows in cogging.values()}) > 1:
        count = cogging["cogging_sine"].shape[1]
        raise MachineError(f"cogging_cosine: needs as many harmonics as cogging_sine, {count}")
    limit = fields.get("current_limit")
    if limit is not None:
        limit = _per_axis("current_limit", limit, axes, positive=True)
    return AxisFile(
        name=checks.text("name", fields.get("name", name)),
        parameters=AxisParameters(friction=Friction(**rubbing), **values, **cogging),
        dt=checks.number("dt", fields["dt"], above=0.0),
        axes=checks.axis_names(fields.get("axes"), axes),
        encoder_resolution=checks.one_or_each(
            "encoder_resolution", fields.get("encoder_resolution", ENCODER_RESOLUTION), axes
        ),
        current_limit=limit,
        electrical=_electrical(fields.get("electrical"), axes),
        notes=_notes(fields.get("notes", [])),
    )


def axis_fields(axis: AxisFile) -> dict[str, Any]:
    """Fields that `axis_from` reads, in plain numbers; those of a single axis without lists."""
    p = axis.parameters
    fields: dict[str, Any] = {
        "kind": KIND,
        "name": axis.name,
        "axes": list(axis.axes),
        "dt": axis.dt,
    }
    fields |= {key: _plain(getattr(p, key)) for key in NUMBERS}
    fields["friction"] = {key: _plain(getattr(p.friction, key)) for key in FRICTION}
    fields |= {key: _plain(getattr(p, key)) for key in ("cogging_sine", "cogging_cosine")}
    fields["encoder_resolution"] = np.asarray(axis.encoder_resolution).tolist()
    if axis.current_limit is not None:
        fields["current_limit"] = _plain(axis.current_limit)
    if axis.electrical is not None:
        fields["electrical"] = {key: _plain(getattr(axis.electrical, key)) for key in ELECTRICAL}
    return fields | ({"notes": list(axis.notes)} if axis.notes else {})


def save_axis(axis: AxisFile, path: Path) -> Path:
    """Write the file that `machine_files.load_machine` reads."""
    return write_json(path, axis_fields(axis))


def _all_there(prefix: str, fields: dict[str, Any], names: tuple[str, ...]) -> None:
    for name in names:
        if name not in fields:
            needed = ", ".join(prefix + one for one in names)
            raise MachineError(f"{prefix}{name}: missing; a flexible axis needs {needed}")


def _count(fields: dict[str, Any]) -> int:
    """Axes: as many as there are names, or numbers in the longest list."""
    named, friction = fields.get("axes"), fields["friction"]
    given = [fields[key] for key in NUMBERS]
    if isinstance(friction, dict):
        given += friction.values()
    cogging = [fields[key] for key in ("cogging_sine", "cogging_cosine")]
    given += [rows for rows in cogging if isinstance(rows, list) and _nested(rows)]
    lengths = [len(value) for value in given if isinstance(value, list)]
    count = len(named) if isinstance(named, list) else max(lengths, default=1)
    if not 1 <= count <= MOST_AXES:
        raise MachineError(f"axes: needs one to {MOST_AXES} axes, received {count}")
    return count


def _per_axis(name: str, value: Any, axes: int, positive: bool) -> np.ndarray:
    values = value if isinstance(value, list) else [value] * axes
    if len(values) != axes:
        raise MachineError(f"{name}: needs one number or {axes}, received {len(values)}")
    bound: dict[str, float] = {"above": 0.0} if positive else {"least": 0.0}
    return np.array([checks.number(name, entry, **bound) for entry in values])


def _harmonics(name: str, value: Any, axes: int) -> np.ndarray:
    rows = value if isinstance(value, list) and _nested(value) else [value] * axes
    if len(rows) != axes:
        raise MachineError(f"{name}: needs one list of harmonics or {axes}, received {len(rows)}")
    if any(
        not isinstance(row, list) or len(row) != len(rows[0]) or len(row) > MOST_HARMONICS
        for row in rows
    ):
        raise MachineError(
            f"{name}: needs lists of equal length, at most {MOST_HARMONICS} harmonics, "
            f"received {checks.shown(value)}"
        )
    entries = [checks.number(name, entry) for row in rows for entry in row]
    return np.array(entries).reshape(axes, -1)


def _nested(rows: list[Any]) -> bool:
    return bool(rows) and isinstance(rows[0], list)


def _electrical(value: Any, axes: int) -> Electrical | None:
    if value is None:
        return None
    given = checks.mapping("electrical", value, set(ELECTRICAL))
    _all_there("electrical.", given, ELECTRICAL)
    return Electrical(
        *(_per_axis(f"electrical.{key}", given[key], axes, positive=True) for key in ELECTRICAL)
    )


def _notes(value: Any) -> tuple[str, ...]:
    if (
        not isinstance(value, list)
        or len(value) > MOST_NOTES
        or not all(isinstance(entry, str) and entry.isprintable() for entry in value)
    ):
        raise MachineError(
            f"notes: needs a list of at most {MOST_NOTES} printable texts, "
            f"received {checks.shown(value)}"
        )
    return tuple(value)


def _plain(values: Any) -> Any:
    """A list over the axes, or what it holds where there is a single axis."""
    rows = np.asarray(values, float).tolist()
    return rows[0] if len(rows) == 1 else rows
