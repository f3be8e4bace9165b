"""Machines of files: the linear model of a machine, its limits, and what is not known about it.

The fields are those of `files.machine_file`; the page "Machine file" of the reference lists them.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.linalg import matrix_balance

from jcontour.analysis.uncertain_loops import Lines, ResponseUncertainty
from jcontour.app.files import checks
from jcontour.app.files.checks import METRES, MachineError
from jcontour.app.files.machine_file import (
    KIND,
    NOTHING_STATED,
    FlexibleAxisFile,
    LimitFields,
    LinearMachineFile,
    LinesFields,
    StatedFields,
    UncertaintyFields,
)
from jcontour.app.files.schema import axis_names, one_or_each, per_axis, read
from jcontour.app.machines.flexible_axis import flexible_machine
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Machine, MachineLimits
from jcontour.app.machines.machine_behaviour import steady_response
from jcontour.app.machines.uncertainty import (
    GAIN_KNOWN_TO,
    IN_FILE,
    IN_PYTHON,
    LATE,
    Uncertainty,
)
from jcontour.linear.plant import LinearPlant, steady_motion
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.linear_machines import ENCODER_RESOLUTION

MOST_BYTES = 16 * 2**20  # of a file
MOST_STATES = 200
CONTROL_NOISE = 0.1  # [control unit] where no limit of the control says more
RANK = (
    1e-10  # smallest singular value, relative, of a mode that the input reaches or the output shows
)


def load_machine(path: str | Path) -> Machine:
    """Machine of a JSON file.

    Raises:
        MachineError: the file cannot be read, or a field is wrong.
    """
    path = Path(path)
    content = checks.bytes_of(path, MOST_BYTES)
    with checks.named(path, MachineError):
        return machine_from(content, path.stem)


def machine_from(content: bytes, name: str = "machine") -> Machine:
    """Machine of the bytes of a JSON file.

    Raises:
        MachineError: as `load_machine`.
    """
    if len(content) > MOST_BYTES:
        raise MachineError(f"file: needs at most {MOST_BYTES} bytes, received {len(content)}")
    try:
        fields = checks.json_value(content)
    except ValueError as error:
        raise MachineError(f"file: {error}") from None
    if not isinstance(fields, dict):
        raise MachineError(
            f"file: needs a JSON object with A, B, C, dt, received {checks.shown(fields)}; "
            f"{checks.EXAMPLE}"
        )
    fields = {"name": name, **fields}
    fields.pop("$schema", None)  # for editors
    if fields.get("kind") == KIND:
        return flexible_machine(read(FlexibleAxisFile, fields))
    file = read(LinearMachineFile, fields)
    metre = METRES[file.length_unit]
    A, B, C = np.array(file.A), np.array(file.B), np.array(file.C)
    if A.shape[0] > MOST_STATES:
        raise MachineError(f"A: needs at most {MOST_STATES} states, received {A.shape[0]}")
    try:
        plant = LinearPlant(A, B, C * metre, file.dt)
    except ValueError as error:
        raise MachineError(checks.line(error)) from None
    model = with_input_delay(plant, file.known_delay)
    _check(A, B, C, model)
    limits = stated_limits(file.limits, metre, plant)
    count = file.encoder_resolution or ENCODER_RESOLUTION / metre
    return LinearMachine(
        file.name or name,
        model,
        axis_names(file.axes, plant.axes),
        file.control_unit,
        limits,
        stated_uncertainty(file.uncertainty, model),
        file.known_delay,
        one_or_each("encoder_resolution", count, plant.axes) * metre,
        file.control_noise or _assumed_noise(limits),
        encoder_noise=one_or_each("encoder_noise", file.encoder_noise, plant.axes) * metre,
        friction=None
        if file.friction is None
        else one_or_each("friction", file.friction, plant.axes),
        friction_known_to=one_or_each("friction_known_to", file.friction_known_to, plant.axes),
        stribeck=_stribeck(file, plant.axes, metre),
        backlash=one_or_each("backlash", file.backlash, plant.axes) * metre,
        note=file.note or "",
    )


def _stribeck(file: LinearMachineFile, axes: int, metre: float):
    """What friction is more at rest, and the speed at which half of that is left [m/s]."""
    if not np.any(file.stribeck_friction):
        return 0.0, 1.0
    if file.friction is None or file.stribeck_speed is None:
        raise MachineError("stribeck_friction: needs friction and stribeck_speed beside it")
    more = one_or_each("stribeck_friction", file.stribeck_friction, axes)
    return more, one_or_each("stribeck_speed", file.stribeck_speed, axes) * metre


def _assumed_noise(limits: MachineLimits) -> float:
    return CONTROL_NOISE if limits.control is None else 0.05 * float(limits.control.min())


def linear_machine(
    plant: LinearPlant, name: str, stated: StatedFields = NOTHING_STATED
) -> LinearMachine:
    """Machine of a linear plant of the user's, as from a file that gives A, B, C, dt.

    Args:
        plant: with two or three axes.
        name: of the machine.
        stated: what is stated of it.

    Raises:
        MachineError: it has not two or three axes, one of them cannot be controlled, or what
            is stated is not of its axes.
    """
    _check(*(np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C)), plant)
    limits = stated_limits(stated.limits, 1.0, plant)
    return LinearMachine(
        name,
        plant,
        axis_names(None, plant.axes),
        stated.control_unit,
        limits,
        stated_uncertainty(stated.uncertainty, plant, IN_PYTHON),
        known_delay=0,
        encoder_resolution=ENCODER_RESOLUTION,
        control_noise=_assumed_noise(limits),
    )


def stated_uncertainty(given: Any, model: LinearPlant, statement: str = IN_FILE) -> Uncertainty:
    """What a file states, the usual where it states nothing at all (None).

    Raises:
        MachineError: limits, or an uncertain response, are not of its axes.
    """
    if given is None:
        # Gains known to 10 %, those of a drive that takes a position exactly; a sample late
        kinds = [steady_response(model, axis).kind for axis in range(model.axes)]
        takes: Literal["position", "speed"] = "position" if "position" in kinds else "speed"
        return Uncertainty(GAIN_KNOWN_TO[takes], LATE, assumed=statement)
    fields = read(UncertaintyFields, given, "uncertainty")
    return Uncertainty(fields.gain, fields.delay, _response(fields, model))


def _lines(name: str, given: LinesFields | None, plant: LinearPlant) -> tuple[Lines, ...]:
    """Lines behind every control; none where a file says nothing."""
    if given is None:
        return ()
    columns = (given.hertz, given.real, given.imaginary, given.half_width)
    if any(len(column) != plant.axes for column in columns):
        raise MachineError(f"uncertainty.{name}: needs {plant.axes} lists in every field")
    lines = []
    for axis in zip(*columns, strict=True):
        if len({len(part) for part in axis}) > 1:
            raise MachineError(f"uncertainty.{name}: its lists need one number per frequency")
        hertz, real, imaginary, half_width = (np.array(part) for part in axis)
        if np.any(hertz <= 0) or np.any(hertz * plant.dt > 0.5) or np.any(half_width < 0):
            raise MachineError(f"uncertainty.{name}: needs frequencies up to half the sample rate")
        lines.append(Lines(2 * np.pi * plant.dt * hertz, real + 1j * imaginary, half_width))
    return tuple(lines)


def _response(fields: UncertaintyFields, plant: LinearPlant) -> ResponseUncertainty | None:
    """What a file says of the response; a frequency in rad per sample."""
    given, names = fields.response, ("measured", "other_amplitudes")
    lines = [_lines(name, getattr(fields, name), plant) for name in names]
    if given is None:
        nothing = np.ones(1), np.zeros((1, plant.axes))
        return ResponseUncertainty(*nothing, *lines) if any(lines) else None
    name, highest = "uncertainty.response", 1 / (2 * plant.dt)
    hertz, relative = np.array(given.hertz), np.array(given.relative)
    if not (hertz[0] > 0 and np.all(np.diff(hertz) > 0) and hertz[-1] <= highest):
        raise MachineError(f"{name}.hertz: needs rising frequencies above 0, up to {highest:g} Hz")
    if relative.shape != (plant.axes, hertz.size) or relative.min() < 0:
        raise MachineError(
            f"{name}.relative: needs {plant.axes} rows of {hertz.size} numbers of at least 0"
        )
    return ResponseUncertainty(2 * np.pi * plant.dt * hertz, relative.T, *lines)


def stated_limits(given: LimitFields, metre: float, plant: LinearPlant) -> MachineLimits:
    """Limits of a file in SI units, its length unit being `metre` [m].

    Raises:
        MachineError: there are more or fewer numbers than axes or inputs.
    """

    def each(name: str, count: int, unit: float) -> np.ndarray | None:
        value = getattr(given, name)
        return None if value is None else per_axis(f"limits.{name}", value, count) * unit

    return MachineLimits(
        speed=each("speed", plant.axes, metre),
        acceleration=each("acceleration", plant.axes, metre),
        control=each("control", plant.inputs, 1.0),
        increment=each("increment", plant.inputs, 1.0),
        jerk=each("jerk", plant.axes, metre),
    )


def _check(A: np.ndarray, B: np.ndarray, C: np.ndarray, model: LinearPlant) -> None:
    """Refuse other than two or three axes, modes out of reach, and a tool without steady motion.

    Hautus: every mode that does not die out is reached by the input and shown by the output,
    whatever the units of states, inputs and outputs: they are balanced.
    """
    n, inputs, outputs = len(A), B.shape[1], len(C)
    if outputs not in (2, 3):
        raise MachineError(
            f"C: needs two or three outputs, the axes of the tool point, received {outputs}"
        )
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
    with checks.named("A, B, C", MachineError):
        steady_motion(model)
