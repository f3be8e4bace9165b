"""Machine files: the linear model of a machine, its limits, and what is not known about it.

A JSON object, or an npz with the same names (`limits.speed`, `uncertainty.response.hertz` for what
is nested), all lengths in `length_unit`:

    A, B, C              matrices of x(k+1) = A x + B u, y = C x; y is the tool point, two or three
    axes, one input each dt                   sample period [s]
    name                 optional
    length_unit          m (default), mm or um: of y, and of the limits and the resolution below
    control_unit         text for tables and figures; "control unit" when not given
    axes                 names, one per output; X, Y, Z when not given
    limits               optional, each one number or one per axis:
                           speed [length/s], acceleration [length/s^2], control [control unit],
                           increment [control unit per sample]; a motion asks for half of the
                           acceleration, see `jobs.pace.SHARE`
    known_delay          samples between a control and its effect that A and B do not contain; goes
    into the model (default 0)
    uncertainty          optional; when not given, gains known to 10 % (of a drive that takes a
                         position: exactly) and a sample of delay. Else what it gives of: gain (0.1:
                         each input gain is known to 10 %; of a drive that takes a position, for
                         moves from where the part begins), delay (most further samples of delay),
                         response: how far off the frequency response
                         may be, as {"hertz": [1, 10, 100], "relative": [[...], [...]]}, one row
                         |G_true / G - 1| per axis. Tuned loops stay stable for twice as much
    encoder_resolution   [length] per count, one number or one per axis; 0.8 um when not given
    encoder_noise        [length] standard deviation of the noise of the encoders beside their
                         rounding, one number or one per axis; 0 when not given
    control_noise        [control unit] standard deviation that the Kalman filter assumes on each
    control;
                         5 % of the control limit, or 0.1, when not given: about what an input gain
                         10 % off does
    note                 optional text that `simulate`, `tune` and `machine` repeat
    friction             [control unit] that dry friction takes on every axis; 0 when not given,
                         null where it is not known. It is in the runs; what is proven takes it as a
                         force

Or a flexible axis, whose fields are those of `axis_files`: an object with "kind": "flexible-axis".

`example.json` beside this file is one; `jcontour machine --example FILE` writes it.
The tool starts in steady motion, so every axis needs
one input and one output of its own.
"""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import matrix_balance

from experiments.files import checks
from experiments.files.axis_file import axis_from, is_axis
from experiments.files.checks import METRES, MachineError
from experiments.machines.flexible_axis import flexible_machine
from experiments.machines.linear import LinearMachine
from experiments.machines.machine import Machine, MachineLimits
from experiments.machines.uncertainty import IN_FILE, IN_PYTHON, MOST_DELAY, stated_uncertainty
from jcontour.linear.plant import LinearPlant, steady_motion
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.bridgeport import ENCODER_RESOLUTION
from jcontour.regular_files import content_of

MOST_BYTES = 16 * 2**20  # of a file, unpacked
MOST_STATES = 200
CONTROL_NOISE = 0.1  # [control unit] where no limit of the control says more
RANK = (
    1e-10  # smallest singular value, relative, of a mode that the input reaches or the output shows
)
FIELDS = {
    "A",
    "B",
    "C",
    "dt",
    "name",
    "length_unit",
    "control_unit",
    "axes",
    "limits",
    "known_delay",
    "uncertainty",
    "encoder_resolution",
    "encoder_noise",
    "control_noise",
    "friction",
    "note",
}


def load_machine(path: str | Path) -> Machine:
    """Machine of a JSON or npz file; the module's docstring is the format.

    Raises:
        MachineError: the file cannot be read, or a field is wrong.
    """
    path = Path(path)
    try:
        content = content_of(path, MOST_BYTES)
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
        fields = checks.json_value(content)
    except ValueError as error:
        raise MachineError(f"file: {error}") from None
    if not isinstance(fields, dict):
        raise MachineError(
            f"file: needs a JSON object with A, B, C, dt, received {checks.shown(fields)}; "
            f"{checks.EXAMPLE}"
        )
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
    except (
        Exception
    ) as error:  # a damaged archive fails in a dozen ways, none of them a fault of this program
        raise MachineError(f"file: not a readable npz ({checks.line(error)})") from None
    for key, value in flat.items():
        *outer, last = key.split(".")
        place = fields
        for name in outer:
            place = place.setdefault(name, {})
            if not isinstance(place, dict):
                raise MachineError(f"{key}: {name} is there as well, needs one or the other")
        if last in place:
            raise MachineError(f"{key}: what it holds is there as well, needs one or the other")
        place[last] = value
    return fields


def _machine(fields: dict[str, Any], name: str) -> Machine:
    if is_axis(fields):
        return flexible_machine(axis_from(fields, name))
    checks.known("file", fields, FIELDS)
    for required in ("A", "B", "C", "dt"):
        if required not in fields:
            raise MachineError(f"{required}: missing; a machine needs A, B, C and dt")
    metre = _unit(fields.get("length_unit", "m"))
    A, B, C = (checks.matrix(key, fields[key]) for key in ("A", "B", "C"))
    dt = checks.number("dt", fields["dt"], above=0.0)
    if A.shape[0] > MOST_STATES:
        raise MachineError(f"A: needs at most {MOST_STATES} states, received {A.shape[0]}")
    try:
        plant = LinearPlant(A, B, C * metre, dt)
    except ValueError as error:
        raise MachineError(checks.line(error)) from None
    _check_axes(plant)
    known_delay = checks.whole("known_delay", fields.get("known_delay", 0), MOST_DELAY)
    _check_modes(A, B, C)
    model = with_input_delay(plant, known_delay)
    _check_motion(model)
    limits = _limits(fields.get("limits", {}), metre, plant)
    unsure = stated_uncertainty(fields.get("uncertainty"), model)
    resolution = (
        checks.one_or_each(
            "encoder_resolution",
            fields.get("encoder_resolution", ENCODER_RESOLUTION / metre),
            plant.axes,
        )
        * metre
    )
    noise = checks.one_or_each(
        "encoder_noise", fields.get("encoder_noise", 0.0), plant.axes, zero=True
    )
    assumed = CONTROL_NOISE if limits.control is None else 0.05 * float(limits.control.min())
    return LinearMachine(
        checks.text("name", fields.get("name", name)),
        model,
        checks.axis_names(fields.get("axes"), plant.axes),
        checks.text("control_unit", fields.get("control_unit", "control unit")),
        limits,
        known_delay,
        unsure.gain,
        unsure.delay,
        resolution,
        checks.number("control_noise", fields.get("control_noise", assumed), above=0.0),
        encoder_noise=noise * metre,
        response_doubt=unsure.response,
        friction=_friction(fields.get("friction", 0.0)),
        note=checks.text("note", fields["note"]) if "note" in fields else "",
        states_family="" if "uncertainty" in fields else IN_FILE,
    )


def linear_machine(plant: LinearPlant, name: str, uncertainty: Any = None) -> LinearMachine:
    """Machine of a linear plant of the user's, as from a file that gives no more than A, B, C, dt.

    Args:
        plant: with two or three axes.
        name: of the machine.
        uncertainty: as in a machine file; the usual where it is None.

    Raises:
        MachineError: it has not two or three axes, one of them cannot be controlled, or a field
            of the uncertainty is wrong.
    """
    _check_axes(plant)
    _check_modes(*(np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C)))
    _check_motion(plant)
    unsure = stated_uncertainty(uncertainty, plant)
    return LinearMachine(
        name,
        plant,
        checks.axis_names(None, plant.axes),
        "control unit",
        MachineLimits(),
        known_delay=0,
        gain=unsure.gain,
        delay=unsure.delay,
        encoder_resolution=ENCODER_RESOLUTION,
        control_noise=CONTROL_NOISE,
        response_doubt=unsure.response,
        states_family="" if uncertainty is not None else IN_PYTHON,
    )


def _check_axes(plant: LinearPlant) -> None:
    if plant.axes not in (2, 3):
        raise MachineError(
            f"C: needs two or three outputs, the axes of the tool point, received {plant.axes}"
        )


def _check_motion(plant: LinearPlant) -> None:
    try:
        steady_motion(plant)
    except ValueError as error:
        raise MachineError(f"A, B, C: {error}") from None


def _limits(value: Any, metre: float, plant: LinearPlant) -> MachineLimits:
    given = checks.mapping("limits", value, set(MachineLimits._fields))
    sizes = {
        "speed": plant.axes,
        "acceleration": plant.axes,
        "control": plant.inputs,
        "increment": plant.inputs,
    }
    scale = {"speed": metre, "acceleration": metre}
    return MachineLimits(
        **{
            key: checks.per_axis(f"limits.{key}", given[key], sizes[key]) * scale.get(key, 1.0)
            for key in given
        }
    )


def _friction(given: Any) -> float | None:
    return None if given is None else checks.number("friction", given, least=0.0)


def _check_modes(A, B, C) -> None:
    """Hautus: every mode that does not die out is reached by the input and shown by the output.

    Whatever the units of states, inputs and outputs: they are balanced.
    """
    n, inputs, outputs = len(A), B.shape[1], len(C)
    whole = np.zeros((n + inputs + outputs,) * 2)
    whole[:n, :n], whole[:n, n : n + inputs], whole[n + inputs :, :n] = A, B, C
    whole[n : n + inputs, n + inputs :] = 1.0  # a loop: what ends in a dead end is not balanced
    balanced, _ = matrix_balance(whole, permute=False)
    A, B, C = balanced[:n, :n], balanced[:n, n : n + inputs], balanced[n + inputs :, :n]
    for name, A_, B_, missing in (
        ("B", A, B, "is out of reach of the inputs"),
        ("C", A.T, C.T, "does not show in the outputs"),
    ):
        for value in np.real_if_close(np.linalg.eigvals(A_)):
            if abs(value) < 1:
                continue
            singular = np.linalg.svd(
                np.hstack([A_ - value * np.eye(len(A_)), B_]), compute_uv=False
            )
            if not singular[-1] > RANK * singular[0]:
                raise MachineError(
                    f"{name}: a mode of A that does not die out (eigenvalue {value:.6g}) {missing}"
                )


def _unit(value: Any) -> float:
    if not isinstance(value, str) or value not in METRES:
        raise MachineError(
            f"length_unit: needs one of {', '.join(METRES)}, received {checks.shown(value)}"
        )
    return METRES[value]
