"""`jcontour identify`: programs that show a machine, and a machine from what was recorded.

Here the flexible axis from the data of its commissioning; `identify_linear` and `excite` have the
rest. The file that it writes is read by the other commands.
"""

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from jcontour.app.commands.machines import excite, identify_linear, identify_response
from jcontour.app.files import run_folder
from jcontour.app.files.axis_file import ElectricalFields, FlexibleAxisFile, save_axis
from jcontour.app.files.record_file import load_records, save_records
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.machines import Identify
from jcontour.app.reports import tables
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.lifecycle import finished
from jcontour.plants.flexible_axis.axis import AxisParameters, thesis_axis
from jcontour.plants.flexible_axis.linear_motor import LinearMotor, thesis_motor
from tuning.identification.flexible_axis.axis import IdentifiedAxis, identify
from tuning.identification.flexible_axis.commissioning import Commissioning
from tuning.identification.flexible_axis.instruments import Instruments
from tuning.identification.flexible_axis.records import Record, mechanical
from tuning.identification.flexible_axis.separability import unseparated

AXIS, DATA = "axis.json", "data.csv"
UNITS = {
    "resistance": "Ohm",
    "inductance": "H",
    "back_emf": "V s/m",
    "force_constant": "N/A",
    "total_mass": "kg",
    "motor_mass": "kg",
    "tool_mass": "kg",
    "stiffness": "N/m",
    "damping": "N s/m",
    "stiffness_per_mass": "1/s^2",
    "damping_per_mass": "1/s",
    "break_away": "N",
    "coulomb": "N",
    "stribeck": "N",
    "stribeck_speed": "m/s",
    "viscous": "N s/m",
    "constant_force": "N",
    "pole_pitch": "m",
}
WAVES = ("amplitude", "sine", "cosine")  # of every harmonic of cogging [N]
RESIDUALS = {  # RMS of what a fit leaves unexplained -> how it is printed
    "force_N": "force {:.3g} N",
    "current_A": "current {:.3g} A",
    "tool_position_m": "end effector {:.3g} m",
}
UNKNOWN = "-"


@dataclass(frozen=True)
class RecordedTest:
    """One test of the commissioning."""

    name: str
    rows: int
    dt: float
    duration: float


@dataclass(frozen=True)
class FoundParameter:
    """One parameter of the axis.

    Attributes:
        parameter: its name.
        unit: its unit.
        separated: whether the data determine it.
        value: None where the data do not show it.
        interval: 95 % interval, of infinite width where noise alone would explain anything.
        truth: value of the simulated axis; None for recorded data.
    """

    parameter: str
    unit: str
    separated: bool
    value: float | None
    interval: tuple[float, float] | None
    truth: float | None


@dataclass(frozen=True)
class IdentifyResult:
    """An identified axis.

    Attributes:
        data: file, or how the data were simulated.
        tests: tests in the data.
        parameters: what was found, and what is not separated.
        fastest: largest sliding speed [m/s].
        residuals: RMS of what every fit leaves unexplained, by `RESIDUALS`.
        notes: what the data cannot tell, and which experiment would.
        model: name of the axis file; None where the data have no end effector.
    """

    data: str
    tests: list[RecordedTest]
    parameters: list[FoundParameter]
    fastest: float
    residuals: dict[str, float]
    notes: list[str]
    model: str | None


def command(flags: Identify) -> int:
    """Fit, store and print; exit code."""
    if flags.excite is not None:
        return excite.command(flags)
    if flags.response is not None:
        return identify_response.command(flags)
    if flags.machine == "linear":
        return identify_linear.command(flags)
    records = records_of(flags)
    found = identify(records, flags.force_constant, flags.pole_pitch)
    folder = run_folder.create(
        flags.out or run_folder.default_folder("identify"),
        "identify",
        flags,
        [] if flags.data is None else [flags.data],
    )
    result = summary_of(flags, records, found)
    _store(flags, records, found, folder)
    write_result(folder, result)
    known = [one for one in result.parameters if one.separated and one.value is not None]
    hidden = [one.parameter for one in result.parameters if not one.separated]
    answer = [
        Entry(
            "Axis", ", ".join(f"{one.parameter} {_number(one.value)} {one.unit}" for one in known)
        ),
        Entry("Hidden", ", ".join(hidden) or "nothing"),
        *(Entry("Note", note) for note in result.notes),
    ]
    if result.model is None:
        answer.append(Entry("Load", "nothing: the model has an end effector, the data do not"))
    else:
        path = folder / result.model
        answer.append(Entry("Load", str(path)))
        answer.append(Entry("Next", f"jcontour tune --plant {shlex.quote(str(path))}"))
    return finished(folder, result, flags, show, answer)


def records_of(flags: Identify) -> list[Record]:
    """Records of the file, or of a simulated commissioning.

    Raises:
        ValueError: neither or both are asked for, or the file cannot be read.
    """
    if flags.demo == (flags.data is not None):
        raise ValueError("identify: needs a CSV file, or --demo for simulated data, and not both")
    if not (np.isfinite(flags.encoder_um) and flags.encoder_um > 0):
        raise ValueError(
            f"encoder-um: needs to be finite and above zero, received {flags.encoder_um}"
        )
    if flags.data is not None:
        return load_records(flags.data)
    return Commissioning(thesis_axis(), thesis_motor(), seed=flags.seed).thesis_tests()


def summary_of(flags: Identify, records: Sequence[Record], found: IdentifiedAxis) -> IdentifyResult:
    """The result of a fit to these records."""
    used = Instruments()
    simulated = (
        "simulated: the axis of Yuan, section 3.3, "
        f"encoders of {1e6 * used.resolution:g} um with {1e6 * used.encoder_noise:g} um of noise, "
        f"currents with {1e3 * used.current_noise:g} mA of noise, seed {flags.seed}"
    )
    return IdentifyResult(
        data=str(flags.data) if flags.data else simulated,
        tests=[RecordedTest(one.name, one.rows, one.dt, one.duration) for one in records],
        parameters=_parameters(found, simulated=flags.demo),
        fastest=found.forces.fastest,
        residuals=_residuals(found),
        notes=list(found.notes),
        model=None if found.parameters is None else AXIS,
    )


def _parameters(found: IdentifiedAxis, simulated: bool) -> list[FoundParameter]:
    estimate, hidden = found.estimate, unseparated(found.estimate)
    truth = _true_values(thesis_axis(), thesis_motor()) if simulated else {}
    orders = range(1, found.forces.cogging.highest + 1)
    units = UNITS | {f"{kind}_{j}": "N" for j in orders for kind in WAVES}
    rows = []
    for name, unit in units.items():
        seen = name in estimate.names
        if not (seen or name in hidden):
            continue
        value = estimate[name] if seen else None
        interval = estimate.interval(name) if seen else None
        told = interval is None or bool(np.isfinite(interval).all())
        separated = told and name not in hidden
        rows.append(FoundParameter(name, unit, separated, value, interval, truth.get(name)))
    return rows


def _true_values(axis: AxisParameters, motor: LinearMotor) -> dict[str, float]:
    """Values of a simulated axis, by the names of an estimate."""
    values = {}
    for source, names in (
        (axis, ("motor_mass", "tool_mass", "stiffness", "damping", "pole_pitch")),
        (axis.friction, ("coulomb", "stribeck", "stribeck_speed", "viscous")),
        (motor, ("resistance", "inductance", "back_emf", "force_constant")),
    ):
        for name in names:
            values[name] = float(getattr(source, name)[0])
    values |= {
        "total_mass": values["motor_mass"] + values["tool_mass"],
        "break_away": values["coulomb"] + values["stribeck"],
        "stiffness_per_mass": values["stiffness"] / values["tool_mass"],
        "damping_per_mass": values["damping"] / values["tool_mass"],
        "constant_force": 0.0,
    }
    waves = zip(axis.cogging_sine[0].tolist(), axis.cogging_cosine[0].tolist(), strict=True)
    for j, (sine, cosine) in enumerate(waves, 1):
        values[f"sine_{j}"] = sine
        values[f"cosine_{j}"] = cosine
        values[f"amplitude_{j}"] = float(np.hypot(sine, cosine))
    return values


def _residuals(found: IdentifiedAxis) -> dict[str, float]:
    """RMS of what every fit leaves unexplained."""

    def rms(parts) -> float:
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))

    left = {"force_N": rms(found.forces.residuals)}
    if found.winding is not None:
        left["current_A"] = rms(found.winding.residuals)
    if found.link is not None:
        left["tool_position_m"] = rms(found.link.residuals)
    return left


def _store(flags: Identify, records: list[Record], found: IdentifiedAxis, folder: Path) -> None:
    from jcontour.app.reports.figures.identification import FIGURES
    from jcontour.app.reports.figures.png import save_figures

    if flags.demo:
        save_records(records, folder / DATA)
    if found.parameters is not None:
        save_axis(_axis_file(flags, records, found, found.parameters), folder / AXIS)
    save_figures(FIGURES, found, folder)


def _axis_file(
    flags: Identify, records: Sequence[Record], found: IdentifiedAxis, parameters: AxisParameters
) -> FlexibleAxisFile:
    optional = {}
    if found.winding is not None:
        names = ElectricalFields.model_fields
        optional["electrical"] = dict(zip(names, found.winding.estimate.values, strict=True))
    if found.notes:
        optional["notes"] = list(found.notes)
    return FlexibleAxisFile.of(
        parameters,
        name="identified-axis" if flags.data is None else flags.data.stem,
        dt=mechanical(records)[0].dt,
        axes=["X"],
        encoder_resolution=1e-6 * flags.encoder_um,
        **optional,
    )


def show(result: IdentifyResult, console: Console) -> None:
    """Print the parameters with their intervals, then what the data cannot tell."""
    tests = []
    for one in result.tests:
        tests.append(f"{one.name} {one.duration:.3g} s at {1 / one.dt:.5g} Hz")
    tables.say(console, f"Data: {result.data}", f"Tests: {', '.join(tests)}")
    simulated = any(row.truth is not None for row in result.parameters)

    def interval(row: FoundParameter) -> str:
        if row.interval is None or not np.isfinite(row.interval).all():
            return UNKNOWN
        return " ... ".join(map(_number, row.interval))

    def spread(row: FoundParameter) -> str:  # unknown where the interval holds zero
        if not row.separated or not row.value or row.interval is None:
            return UNKNOWN
        low, high = row.interval
        known = np.isfinite(high - low) and not low <= 0 <= high
        return f"{100 * (high - low) / 2 / abs(row.value):.2g}" if known else UNKNOWN

    def error(row: FoundParameter) -> str:
        if not row.separated or row.value is None or row.interval is None or not row.truth:
            return UNKNOWN
        return f"{100 * (row.value / row.truth - 1):+.2f}"

    columns: dict[str, Callable[[FoundParameter], str]] = {
        "parameter": lambda row: row.parameter,
        "unit": lambda row: row.unit,
        "value": lambda row: _number(row.value) if row.separated else "not separated",
        "95 % interval": interval,
        "+- %": spread,
    }
    if simulated:
        columns |= {"truth": lambda row: _number(row.truth), "off %": error}
    console.print(tables.table_of("Identified axis", result.parameters, columns, text_columns=2))
    left = [RESIDUALS[name].format(value) for name, value in result.residuals.items()]
    notes = [f"NOTE: {note}" for note in result.notes]
    tables.say(console, f"Left unexplained, RMS: {', '.join(left)}", *notes)


def _number(value: float | None) -> str:
    return UNKNOWN if value is None or not np.isfinite(value) else f"{value:.5g}"
