"""Machine files: the linear model of a machine, its limits, and what is not known about it.

A JSON object, or an npz with the same names (`limits.speed` for what is nested), all lengths in `length_unit`:

    A, B, C              matrices of x(k+1) = A x + B u, y = C x; y is the tool point, two or three axes, one input each
    dt                   sample period [s]
    name                 optional
    length_unit          m (default), mm or um: of y, and of the limits and the resolution below
    control_unit         text for tables and figures; "control unit" when not given
    axes                 names, one per output; X, Y, Z when not given
    limits               optional, each one number or one per axis:
                           speed [length/s], acceleration [length/s^2], control [control unit], increment [control unit per sample]
    known_delay          samples between a control and its effect that A and B do not contain; goes into the model (default 0)
    uncertainty          optional: gain (0.1: each input gain is known to 10 %), delay (most further samples of delay)
    encoder_resolution   [length] per count; 0.8 um when not given
    control_noise        [control unit] standard deviation that the Kalman filter assumes on each control;
                         5 % of the control limit, or 0.1, when not given: about what an input gain 10 % off does

`experiments/machines/example.json` is one. The tool starts in steady motion, so every axis needs one input and one output of its own.
"""

import io
import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jcontour.linear import LinearPlant, steady_motion, with_input_delay, with_input_gains
from jcontour.plants.bridgeport import ENCODER_RESOLUTION, bridgeport
from jcontour.plants.wrappers import Delayed, Encoders, Quantised

METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
MOST_BYTES = 16 * 2**20  # of a file, unpacked
MOST_STATES, MOST_DELAY = 200, 50
LARGEST = 1e12  # of any number: beyond it squares overflow somewhere
RANK = 1e-10  # smallest singular value, relative, of a mode that the input reaches or the output shows
FIELDS = {
    "A", "B", "C", "dt", "name", "length_unit", "control_unit", "axes", "limits", "known_delay", "uncertainty",
    "encoder_resolution", "control_noise",
}  # fmt: skip


class MachineError(ValueError):
    """A machine file that cannot be used; one line: field, what was received, what is needed."""


class MachineLimits(NamedTuple):
    """Greatest magnitudes per axis (m,), SI and control units; None where not given."""

    speed: np.ndarray | None = None
    acceleration: np.ndarray | None = None
    control: np.ndarray | None = None
    increment: np.ndarray | None = None


@dataclass(frozen=True)
class Machine:
    """A machine as the commands see it; lengths in metres.

    Attributes:
        model: what a controller may know: the plant, its known delay included.
        gain: relative uncertainty of the input gains.
        delay: most samples of delay that the model does not know.
    """

    name: str
    model: LinearPlant
    axes: tuple[str, ...]
    control_unit: str
    limits: MachineLimits
    known_delay: int
    gain: float
    delay: int
    encoder_resolution: float
    control_noise: float

    @property
    def members(self) -> list[tuple[str, np.ndarray, int]]:
        """Name, input gains and extra delay of every plant of the family, the nominal one first."""
        sign = np.where(np.arange(self.model.inputs) % 2 == 0, 1.0, -1.0)
        gains = [("nominal", 0 * sign)]
        if self.gain > 0:
            gains += [("gains " + ", ".join(f"{g:.3g}" for g in 1 + s * self.gain * sign), s * self.gain * sign) for s in (1, -1)]
        late = [(f"{d} sample{'s' if d > 1 else ''} late", 0 * sign, d) for d in range(1, self.delay + 1)]
        return [(name, 1 + change, 0) for name, change in gains] + [(name, 1 + change, d) for name, change, d in late]

    def family(self, quantised: bool) -> Sequence[Encoders | Quantised]:
        """Every plant of the family behind its encoders, all of one structure; `quantised` rounds to whole counts."""
        depth = max(self.delay, 1)
        smooth = [
            Encoders(Delayed(with_input_gains(self.model, gains), jnp.asarray(delay), depth, self.model.inputs))
            for _, gains, delay in self.members
        ]
        return [Quantised(plant, self.encoder_resolution) for plant in smooth] if quantised else smooth

    @property
    def measurement_noise(self) -> float:
        """Standard deviation of a rounded position [m]: resolution / sqrt(12)."""
        return self.encoder_resolution / np.sqrt(12)


def bridgeport_machine() -> Machine:
    """The paper's X-Y table; it states no limits, and of its uncertainty only that models are never exact."""
    return Machine(
        "bridgeport", bridgeport(), ("X", "Y"), "control unit", MachineLimits(),
        known_delay=0, gain=0.1, delay=2, encoder_resolution=ENCODER_RESOLUTION, control_noise=0.1,
    )  # fmt: skip


def load_machine(path: str | Path) -> Machine:
    """Machine of a JSON or npz file; the module's docstring is the format.

    Raises:
        MachineError: the file cannot be read, or a field is wrong.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise MachineError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        return machine_from(content, path.stem)
    except MachineError as error:
        raise MachineError(f"{path}: {error}") from None


def machine_from(content: bytes, name: str = "machine") -> Machine:
    """Machine of the bytes of a JSON or npz file.

    Raises:
        MachineError: as `load_machine`.
    """
    if len(content) > MOST_BYTES:
        raise MachineError(f"file: needs at most {MOST_BYTES} bytes, received {len(content)}")
    fields = _npz_fields(content) if content[:2] == b"PK" else _json_fields(content)
    return _machine(fields, name)


def _json_fields(content: bytes) -> dict[str, Any]:
    try:
        fields = json.loads(content.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise MachineError(f"file: neither JSON nor npz ({_line(error)})") from None
    if not isinstance(fields, dict):
        raise MachineError(f"file: needs a JSON object with A, B, C, dt, received {_shown(fields)}")
    return fields


def _npz_fields(content: bytes) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MOST_BYTES:
                raise MachineError(f"file: needs at most {MOST_BYTES} bytes unpacked")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            flat = {key: arrays[key].tolist() for key in arrays.files}
    except MachineError:
        raise
    except Exception as error:  # a damaged archive fails in a dozen ways, none of them a fault of this program
        raise MachineError(f"file: not a readable npz ({_line(error)})") from None
    for key, value in flat.items():
        outer, _, inner = key.partition(".")
        if inner:
            nested = fields.setdefault(outer, {})
            if not isinstance(nested, dict):
                raise MachineError(f"{key}: {outer} is there as well, needs one or the other")
            nested[inner] = value
        else:
            fields[key] = value
    return fields


def _machine(fields: dict[str, Any], name: str) -> Machine:
    _known("file", fields, FIELDS)
    for required in ("A", "B", "C", "dt"):
        if required not in fields:
            raise MachineError(f"{required}: missing; a machine needs A, B, C and dt")
    metre = _unit(fields.get("length_unit", "m"))
    A, B, C = (_matrix(key, fields[key]) for key in ("A", "B", "C"))
    dt = _number("dt", fields["dt"], above=0.0)
    if A.shape[0] > MOST_STATES:
        raise MachineError(f"A: needs at most {MOST_STATES} states, received {A.shape[0]}")
    try:
        plant = LinearPlant(A, B, C * metre, dt)
    except ValueError as error:
        raise MachineError(_line(error)) from None
    if plant.axes not in (2, 3):
        raise MachineError(f"C: needs two or three outputs, the axes of the tool point, received {plant.axes}")
    known_delay = _whole("known_delay", fields.get("known_delay", 0), MOST_DELAY)
    _check_modes(A, B, C)
    model = with_input_delay(plant, known_delay)
    try:
        steady_motion(model)
    except ValueError as error:
        raise MachineError(f"A, B, C: {_line(error)}") from None
    limits = _limits(fields.get("limits", {}), metre, plant)
    uncertainty = _object("uncertainty", fields.get("uncertainty", {}), {"gain", "delay"})
    gain = _number("uncertainty.gain", uncertainty.get("gain", 0.0), least=0.0)
    if gain >= 1:
        raise MachineError(f"uncertainty.gain: needs a fraction below 1, received {gain:g}")
    resolution = _number("encoder_resolution", fields.get("encoder_resolution", ENCODER_RESOLUTION / metre), above=0.0) * metre
    assumed = 0.1 if limits.control is None else 0.05 * float(limits.control.min())
    return Machine(
        _text("name", fields.get("name", name)), model, _axes(fields.get("axes"), plant.axes),
        _text("control_unit", fields.get("control_unit", "control unit")), limits, known_delay, gain,
        _whole("uncertainty.delay", uncertainty.get("delay", 0), MOST_DELAY), resolution,
        _number("control_noise", fields.get("control_noise", assumed), above=0.0),
    )  # fmt: skip


def _limits(value: Any, metre: float, plant: LinearPlant) -> MachineLimits:
    given = _object("limits", value, set(MachineLimits._fields))
    sizes = {"speed": plant.axes, "acceleration": plant.axes, "control": plant.inputs, "increment": plant.inputs}
    scale = {"speed": metre, "acceleration": metre}
    return MachineLimits(**{key: _per_axis(f"limits.{key}", given[key], sizes[key]) * scale.get(key, 1.0) for key in given})


def _check_modes(A, B, C) -> None:
    """Hautus: every mode that does not die out is reached by the input and shown by the output."""
    for name, A_, B_, missing in (("B", A, B, "is out of reach of the inputs"), ("C", A.T, C.T, "does not show in the outputs")):
        B_ = B_ / max(np.abs(B_).max(), 1e-300)
        for value in np.linalg.eigvals(A_):
            if abs(value) < 1:
                continue
            singular = np.linalg.svd(np.hstack([A_ - value * np.eye(len(A_)), B_]), compute_uv=False)
            if not singular[-1] > RANK * singular[0]:
                raise MachineError(f"{name}: a mode of A that does not die out (eigenvalue {value:.6g}) {missing}")


def _matrix(name: str, value: Any) -> np.ndarray:
    try:
        matrix = np.array(value, dtype=float)
    except (ValueError, TypeError, OverflowError, RecursionError):
        raise MachineError(f"{name}: needs a matrix of numbers, received {_shown(value)}") from None
    if matrix.ndim != 2 or matrix.size == 0:
        raise MachineError(f"{name}: needs a matrix, a list of rows of equal length, received shape {matrix.shape}")
    if isinstance(value, list) and any(isinstance(entry, (str, bool)) for row in value for entry in row):
        raise MachineError(f"{name}: needs numbers, received text or true/false among them")
    if not np.isfinite(matrix).all():
        raise MachineError(f"{name}: every entry needs to be finite, received NaN or inf")
    if np.abs(matrix).max() > LARGEST:
        raise MachineError(f"{name}: needs entries of at most {LARGEST:g}, received {np.abs(matrix).max():g}")
    return matrix


def _number(name: str, value: Any, least: float = -LARGEST, above: float | None = None) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise MachineError(f"{name}: needs a number, received {_shown(value)}")
    if not (abs(value) <= LARGEST and value >= least and (above is None or value > above)):
        bound = f"above {above:g}" if above is not None else f"of at least {least:g}"
        raise MachineError(f"{name}: needs a finite number {bound}, received {_shown(value)}")
    return float(value)


def _whole(name: str, value: Any, most: int) -> int:
    number = _number(name, value, least=0)
    if number != int(number) or number > most:
        raise MachineError(f"{name}: needs a whole number of samples from 0 to {most}, received {number:g}")
    return int(number)


def _per_axis(name: str, value: Any, size: int) -> np.ndarray:
    values = value if isinstance(value, list) else [value] * size
    if len(values) != size:
        raise MachineError(f"{name}: needs one number or {size}, received {len(values)}")
    return np.array([_number(name, entry, above=0.0) for entry in values])


def _axes(value: Any, count: int) -> tuple[str, ...]:
    if value is None:
        return ("X", "Y", "Z")[:count]
    if not isinstance(value, list) or len(value) != count or len({str(entry) for entry in value}) != count:
        raise MachineError(f"axes: needs {count} different names, one per output, received {_shown(value)}")
    return tuple(_text("axes", entry) for entry in value)


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str) or not value.isprintable() or not 0 < len(value) <= 80:
        raise MachineError(f"{name}: needs a text of 1 to 80 printable characters, received {_shown(value)}")
    return value


def _unit(value: Any) -> float:
    if not isinstance(value, str) or value not in METRES:
        raise MachineError(f"length_unit: needs one of {', '.join(METRES)}, received {_shown(value)}")
    return METRES[value]


def _object(name: str, value: Any, allowed: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MachineError(f"{name}: needs an object with {', '.join(sorted(allowed))}, received {_shown(value)}")
    _known(name, value, allowed)
    return value


def _known(name: str, fields: dict[str, Any], allowed: set[str]) -> None:
    unknown = sorted(set(fields) - allowed)
    if unknown:
        raise MachineError(f"{name}: there is no field {_shown(unknown[0])}; known are {', '.join(sorted(allowed))}")


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # Python refuses to print integers of thousands of digits
        text = type(value).__name__
    return text if len(text) <= 60 else text[:57] + "..."


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
