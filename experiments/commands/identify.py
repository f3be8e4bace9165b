"""`jcontour identify data.csv`: a flexible axis from its commissioning data, and the axis file that the other commands read."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from experiments.files import run_folder
from experiments.files.axis_file import AxisFile, Electrical, save_axis
from experiments.files.record_file import load_records, save_records
from experiments.options import Identify
from experiments.reports import tables
from jcontour.plants.flexible_axis.axis import AxisParameters, thesis_axis
from jcontour.plants.flexible_axis.linear_motor import LinearMotor, thesis_motor
from tuning.identification.axis import IdentifiedAxis, identify
from tuning.identification.commissioning import Commissioning
from tuning.identification.instruments import Instruments
from tuning.identification.records import Record, mechanical
from tuning.identification.separability import unseparated

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


def command(flags: Identify) -> int:
    """The whole command: fit, store, print."""
    records = _records(flags)
    found = identify(records, flags.force_constant, flags.pole_pitch)
    folder = run_folder.create(
        flags.out or run_folder.default_folder("identify"),
        "identify",
        flags,
        [] if flags.data is None else [flags.data],
    )
    summary = run_folder.plain(_summary(flags, records, found))
    _store(flags, records, found, folder, summary)
    if flags.json:
        print(run_folder.json_text({"run": str(folder), **summary}))
    else:
        show(summary, folder, tables.console_of())
    return 0


def _records(flags: Identify) -> list[Record]:
    if flags.demo == (flags.data is not None):
        raise ValueError("identify: needs a CSV file, or --demo for simulated data, and not both")
    if not (np.isfinite(flags.encoder_um) and flags.encoder_um > 0):
        raise ValueError(
            f"encoder-um: needs to be finite and above zero, received {flags.encoder_um}"
        )
    if flags.data is not None:
        return load_records(flags.data)
    return Commissioning(thesis_axis(), thesis_motor(), seed=flags.seed).thesis_tests()


def _summary(flags: Identify, records: Sequence[Record], found: IdentifiedAxis) -> dict[str, Any]:
    estimate, hidden = found.estimate, unseparated(found.estimate)
    truth = _truth(thesis_axis(), thesis_motor()) if flags.demo else {}
    waves = {f"{kind}_{j}": "N" for j in range(1, found.forces.cogging.count + 1) for kind in WAVES}
    rows = [
        {
            "parameter": name,
            "unit": unit,
            "separated": name not in hidden,
            "value": estimate[name] if name in estimate.names else None,
            "interval": estimate.interval(name) if name in estimate.names else None,
            "truth": truth.get(name),
        }
        for name, unit in (UNITS | waves).items()
        if name in estimate.names or name in hidden
    ]
    return {
        "data": str(flags.data) if flags.data else _demo(flags.seed),
        "tests": [
            {"name": one.name, "rows": one.rows, "dt": one.dt, "duration": one.duration}
            for one in records
        ],
        "parameters": rows,
        "fastest": found.forces.fastest,
        "residuals": _residuals(found),
        "notes": found.notes,
        "model": None if found.parameters is None else AXIS,
    }


def _demo(seed: int) -> str:
    i = Instruments()
    return (
        f"simulated: the axis of Yuan, section 3.3, encoders of {1e6 * i.resolution:g} um with {1e6 * i.encoder_noise:g} um of noise, "
        f"currents with {1e3 * i.current_noise:g} mA of noise, seed {seed}"
    )


def _truth(axis: AxisParameters, motor: LinearMotor) -> dict[str, float]:
    """Of a simulated axis, by the names of an estimate."""
    names = ("motor_mass", "tool_mass", "stiffness", "damping", "pole_pitch")
    values = {name: float(getattr(axis, name)[0]) for name in names}
    values |= {
        name: float(getattr(axis.friction, name)[0])
        for name in ("coulomb", "stribeck", "stribeck_speed", "viscous")
    }
    values |= {
        name: float(getattr(motor, name)[0])
        for name in ("resistance", "inductance", "back_emf", "force_constant")
    }
    values |= {
        "total_mass": values["motor_mass"] + values["tool_mass"],
        "break_away": values["coulomb"] + values["stribeck"],
        "stiffness_per_mass": values["stiffness"] / values["tool_mass"],
        "damping_per_mass": values["damping"] / values["tool_mass"],
        "constant_force": 0.0,
    }
    for j, (sine, cosine) in enumerate(
        zip(axis.cogging_sine[0].tolist(), axis.cogging_cosine[0].tolist(), strict=True), 1
    ):
        values |= {
            f"sine_{j}": sine,
            f"cosine_{j}": cosine,
            f"amplitude_{j}": float(np.hypot(sine, cosine)),
        }
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


def _store(
    flags: Identify,
    records: list[Record],
    found: IdentifiedAxis,
    folder: Path,
    summary: dict[str, Any],
) -> None:
    from experiments.reports.identification_figures import FIGURES
    from experiments.reports.png import save_figures

    if flags.demo:
        save_records(records, folder / DATA)
    if found.parameters is not None:
        save_axis(_axis_file(flags, records, found, found.parameters), folder / AXIS)
    save_figures(FIGURES, found, folder)
    run_folder.write_json(folder / run_folder.RESULT, summary)


def _axis_file(
    flags: Identify, records: Sequence[Record], found: IdentifiedAxis, parameters: AxisParameters
) -> AxisFile:
    winding = found.winding
    electrical = (
        None
        if winding is None
        else Electrical(*(np.array([value]) for value in winding.estimate.values))
    )
    return AxisFile(
        name="identified-axis" if flags.data is None else flags.data.stem,
        parameters=parameters,
        dt=mechanical(records)[0].dt,
        axes=("X",),
        encoder_resolution=1e-6 * flags.encoder_um,
        electrical=electrical,
        notes=found.notes,
    )


def show(summary: dict[str, Any], folder: Path, console: Console) -> None:
    """Parameters with their intervals, then what the data cannot tell."""
    tests = ", ".join(
        f"{one['name']} {one['duration']:.3g} s at {1 / one['dt']:.5g} Hz"
        for one in summary["tests"]
    )
    tables.say(console, f"Data: {summary['data']}", f"Tests: {tests}")
    simulated = any(row["truth"] is not None for row in summary["parameters"])
    columns = [
        "parameter",
        "unit",
        "value",
        "95 % interval",
        "+- %",
        *(["truth", "off %"] if simulated else []),
    ]
    rows = [_cells(row, simulated) for row in summary["parameters"]]
    console.print(tables.plain_table("Identified axis", columns, rows, text_columns=2))
    left = {
        "force_N": "force {:.3g} N",
        "current_A": "current {:.3g} A",
        "tool_position_m": "end effector {:.3g} m",
    }
    unexplained = ", ".join(
        left[name].format(value) for name, value in summary["residuals"].items()
    )
    tables.say(
        console,
        f"Left unexplained, RMS: {unexplained}",
        *(f"NOTE: {note}" for note in summary["notes"]),
    )
    model = (
        f"Axis file: {folder / AXIS}"
        if summary["model"]
        else "No axis file: the model has an end effector, the data do not"
    )
    tables.say(console, model, f"Run folder: {folder}")


def _cells(row: dict[str, Any], simulated: bool) -> list[str]:
    """One line; of what is not separated only the interval is shown, where there is one."""
    interval, relative, off = "-", "-", "-"
    if row["interval"] is not None:
        low, high = row["interval"]
        interval = f"{_number(low)} ... {_number(high)}"
        if row["separated"]:
            relative = (
                "-" if low <= 0 <= high else f"{100 * (high - low) / 2 / abs(row['value']):.2g}"
            )
            off = f"{100 * (row['value'] / row['truth'] - 1):+.2f}" if row["truth"] else "-"
    value = _number(row["value"]) if row["separated"] else "not separated"
    truth = [] if not simulated else ["-" if row["truth"] is None else _number(row["truth"]), off]
    return [row["parameter"], row["unit"], value, interval, relative, *truth]


def _number(value: float) -> str:
    return f"{value:.5g}"
