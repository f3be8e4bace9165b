"""`jcontour machine`: a machine file from what is known of the axes; checks and draws a file."""

import shlex
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

import jcontour.app.machines
from jcontour.app.catalogue.choices import machine_named
from jcontour.app.files import run_folder
from jcontour.app.files.results.machine_results import MachineResult
from jcontour.app.files.results.run_metrics import AxisSummary
from jcontour.app.files.results.stored import to_json
from jcontour.app.flags.machines import Machine as Flags
from jcontour.app.machines.built import built_machine
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.machine import Machine
from jcontour.app.machines.machine_behaviour import (
    axis_behaviours,
    questions,
    response,
    steady_response,
    step_response,
)
from jcontour.app.plain_numbers import MM_PER_MIN, feed_words
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import CYCLE, grid, legend_below, plain_ticks, save_figure

EXAMPLE = Path(jcontour.app.machines.__file__).parent / "example.json"
OF_NO_MACHINE = ("file", "example", "json")  # flags that do not describe a machine
SOUND = "The file is sound."
POINTS = 300
SHOWN = 8.0  # rise times of the step response that are drawn


def command(flags: Flags) -> int:
    """The whole command: build or read, check, draw, print, exit code."""
    words, warnings, text = [], [], ""
    if flags.example is not None:
        _check_alone(flags, "write the example")
        if flags.file is not None:
            raise ValueError("file: is to be checked; leave it out to write the example")
        path, text = _new("example", flags.example), EXAMPLE.read_text()
        machine = machine_from(text.encode(), EXAMPLE.stem)
    elif flags.file is None:
        path = _new("out", flags.out or Path(flags.name))
        built = built_machine(flags)
        text, words, warnings = (
            run_folder.json_text(built.fields) + "\n",
            built.words,
            built.warnings,
        )
        machine = machine_from(text.encode(), flags.name)
    else:  # a file, or a machine of the catalogue
        _check_alone(flags, "check a file")
        machine, path = machine_named(str(flags.file)), Path(str(flags.file))
    picture = path.with_suffix(".png") if path.suffix else Path(f"{machine.name}.png")
    result = _result(machine, path, picture, words, warnings)
    if text:
        path.parent.mkdir(parents=True, exist_ok=True)
        run_folder.write(path, lambda temporary: temporary.write_text(text))
    _draw(machine, result.axes, picture)
    if flags.json:
        print(run_folder.json_text(to_json(result)))
        return 0
    show(result, tables.console_of())
    built = flags.file is None
    name = path if built or path.suffix else result.name
    sound = "The file can be read, but look at the warnings." if result.warnings else SOUND
    tables.say(
        tables.console_of(),
        f"Drawn: {result.figure}",
        f"Written: {path}" if built else sound,
        f"Next: jcontour tune --plant {shlex.quote(str(name))}",
    )
    return 0


def _new(flag: str, given: Path) -> Path:
    """Path of a new machine file, with a name that the commands take for one."""
    path = given if given.suffix.lower() == ".json" else given.with_name(f"{given.name}.json")
    if path.exists():
        raise ValueError(f"{flag}: {path} exists; give another name")
    return path


def _check_alone(flags: Flags, purpose: str) -> None:
    """Raise ValueError where flags describe a new machine."""
    for one in fields(flags):
        if one.name not in OF_NO_MACHINE and getattr(flags, one.name) != one.default:
            name = one.name.replace("_", "-")
            raise ValueError(f"{name}: describes a new machine; leave it out to {purpose}")


def _result(
    machine: Machine, path: Path, picture: Path, words: list[str], warnings: list[str]
) -> MachineResult:
    axes = axis_behaviours(machine)
    # Limits of the axes in words, one number where all axes have the same
    limits, unit = machine.limits, machine.control_unit
    stated = [
        f"{quantity} {_each(limit)} {shown}"
        for quantity, limit, shown in (
            ("acceleration", limits.acceleration, "m/s^2"),
            ("jerk", limits.jerk, "m/s^3"),
            ("control", limits.control, unit),
            ("control increment", limits.increment, f"{unit} per sample"),
        )
        if limit is not None
    ]
    if limits.speed is not None:
        stated.insert(0, f"speed {feed_words(*limits.speed)}")
    return MachineResult(
        name=machine.name,
        file=str(path),
        figure=str(picture),
        control_unit=machine.control_unit,
        period=machine.model.dt,
        description=machine.description() | {"Limits": ("; ".join(stated) or "none is stated")},
        family=list(machine.family_names),
        words=words,
        axes=axes,
        warnings=[*warnings, *questions(machine, axes)],
    )


def _each(values: np.ndarray) -> str:
    """Numbers of all axes, one where all are the same."""
    texts = [f"{one:.4g}" for one in values]
    return ", ".join(texts[:1] if len(set(texts)) == 1 else texts)


def _draw(machine: Machine, behaviours: list[AxisSummary], path: Path) -> None:
    """Speed after a step of the control; magnitude and phase from control to position."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    panels = figure.subplot_mosaic([["step", "size"], ["step", "phase"]])
    step, size, phase = panels["step"], panels["size"], panels["phase"]
    dt, unit = machine.model.dt, machine.control_unit
    frequency = np.geomspace(1e-3 / dt, 0.499 / dt, POINTS)
    for k, one in enumerate(behaviours):
        colour = CYCLE[k % len(CYCLE)]
        rise = one.rise if np.isfinite(one.rise) and one.rise > 0 else 100 * dt
        moved = step_response(machine.model, k, steady_response(machine.model, k))
        last = min(int((SHOWN * rise) / dt) + one.delay + 3, len(moved) - 2)
        speed = np.diff(moved)[:last] / dt
        shown = 1e3 * moved[:last] if one.kind == "position" else speed / MM_PER_MIN
        step.plot(1e3 * dt * np.arange(last), shown, color=colour, label=one.name)
        values = response(machine.model, k, frequency)
        size.plot(frequency, 1e3 * np.abs(values), color=colour)
        phase.plot(frequency, np.degrees(np.unwrap(np.angle(values))), color=colour)
    what = (
        "position [mm]" if all(one.kind == "position" for one in behaviours) else "speed [mm/min]"
    )
    grid(step, f"{machine.name}: after a step of one {unit}", "time [ms]", what)
    size.set(xscale="log", yscale="log")
    phase.set(xscale="log")
    for axes in (size, phase):
        plain_ticks(axes.xaxis)
    grid(size, "control to position", "", f"mm per {unit}")
    grid(phase, "", "frequency [Hz]", "phase [degrees]")
    legend_below(figure)
    save_figure(figure, path)


def show(result: MachineResult, console: Console) -> None:
    """What the machine is, axis by axis."""
    lines = [f"{heading:<11} {words}" for heading, words in result.description.items()]
    tables.say(console, *lines, f"{'Family':<11} {'; '.join(result.family)}", *result.words)
    columns: dict[str, Callable[[AxisSummary], str | float]] = {
        "axis": lambda axis: axis.name,
        "settles to": lambda axis: axis.kind,
        "per unit": _gain,
        "rise ms": lambda axis: 1e3 * axis.rise,
        "delay": lambda axis: str(axis.delay),
        "most m/s^2": lambda axis: axis.acceleration,
        "resonance Hz": lambda axis: axis.resonance,
    }
    title = f"One {result.control_unit} on each axis by itself"
    console.print(tables.table_of(title, result.axes, columns, text_columns=3))
    tables.say(console, *(f"WARNING: {line}" for line in result.warnings))


def _gain(axis: AxisSummary) -> str:
    """Where one unit of the control takes an axis."""
    match axis.kind:
        case "speed":
            return feed_words(axis.gain)
        case "acceleration":
            return f"{tables.digits(axis.gain)} m/s^2"
        case "position":
            return f"{tables.digits(1e3 * axis.gain)} mm"
    return "-"
