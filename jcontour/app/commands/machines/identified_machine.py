"""What `jcontour identify` makes of the models of a record: a machine file, figures and words."""

import shlex
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.checks import ANGLE, MachineError
from jcontour.app.files.log_file import Log
from jcontour.app.files.results.machine_results import LinearAxisResult, LinearMachineResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.machines import Identify
from jcontour.app.machines import identified
from jcontour.app.machines import machine_behaviour as usual
from jcontour.app.machines.from_file import machine_from
from jcontour.app.plain_numbers import feed_words
from jcontour.app.reports import tables
from jcontour.app.reports.screen import Entry
from jcontour.app.reports.tables import of_axes
from jcontour.app.runs.lifecycle import finished
from jcontour.export.code_text import heading
from tuning.identification.linear.identified_axes import IdentifiedMachine

MODEL, DATA = "machine.json", "data.csv"
GAIN_ASKED = 1000.0  # m/s or m per unit: more is a wrong unit
TINY, FINE = 1e-3, 5e-9  # [m]: a whole record, and a count, that are questioned together


def kept(flags: Identify, log: Log, source: str, machine: IdentifiedMachine) -> int:
    """Check, store and print; exit code."""
    name = "identified" if flags.data is None else flags.data.stem
    try:  # what the other commands would refuse is not written
        text = run_folder.json_text(_fields(machine, name, flags.control_unit)) + "\n"
        machine_from(text.encode(), name)
    except MachineError as error:
        questions = [] if any(log.angles) else _tiny(flags, machine)
        raise ValueError(
            f"no controller could be tuned for what fits the record ({error}): record a livelier "
            "program: jcontour identify --excite" + "".join(f". {line}" for line in questions)
        ) from None
    inputs = [] if flags.data is None else [flags.data]
    folder = run_folder.create(flags.out, "identify", flags, inputs)
    run_folder.write(folder / MODEL, lambda temporary: temporary.write_text(text))
    if flags.demo:
        time = log.dt * np.arange(len(log.command))
        heads = ["time_s"]
        heads += [heading(f"{a.lower()}_command", flags.control_unit) for a in flags.axes]
        head = ",".join([*heads, *(f"{a.lower()}_position_m" for a in flags.axes)])
        rows = np.column_stack([time, log.command, log.position])
        run_folder.write(
            folder / DATA,
            lambda temporary: np.savetxt(temporary, rows, "%.10g", ",", header=head, comments=""),
        )
    from jcontour.app.reports.figures.axes import save_figures  # not before what may refuse
    from jcontour.app.reports.figures.identification import figures

    save_figures(figures(flags.control_unit), machine, folder)
    result = _result(flags, log, source, machine)
    write_result(folder, result)
    path = folder / MODEL
    quoted = shlex.quote(str(path))
    answer = [
        *(Entry(one.name, axis_words(one, flags.control_unit)) for one in result.axes),
        Entry("Limits", "the largest of the record stand in the file: put the machine's own there"),
        *(Entry("Note", one) for one in log.words if one.startswith("time:") or ANGLE in one),
        *(Entry("Note", note) for note in result.notes),
    ]
    if any(one.friction is not None for one in result.axes):
        acts = "the tables of tune have this friction in their runs; what it proves is for such a"
        answer.append(Entry("Friction", f"{acts} force"))
    answer += [Entry("To load", str(path)), Entry("Next", f"jcontour machine {quoted}")]
    return finished(folder, result, flags, show, answer)


def axis_words(one: LinearAxisResult, control_unit: str) -> str:
    """Model of an axis in a line, with what is known of its gain and up to which frequency."""
    gain = f"{gain_words(one)} per {control_unit}"
    low, high = one.gain_interval
    measured = f", measured to {one.measured_to:.3g} Hz" if one.measured_to else ""
    known = f" +- {50 * (high - low) / abs(one.gain):.2g} %" if one.gain else ""
    shown = f"to {one.shown_to:.3g} Hz" if np.isfinite(one.shown_to) else "to 10 % nowhere"
    return (
        f"{words_of(one)}; gain {gain}{known}, delay {one.delay} samples, known "
        f"{shown}{measured}, explains {100 * one.explained:.2f} %"
    )


def _fields(machine: IdentifiedMachine, name: str, control_unit: str) -> dict[str, Any]:
    """Fields of the machine file; of one axis it has a copy, as a contour needs two."""
    if len(machine.axes) > 1:
        return identified.machine_fields(machine, name, control_unit)
    axis = machine.axes[0].name
    note = f"{_other(axis)} was not measured: it is a copy of {axis}"
    fields = identified.machine_fields(machine.twice(_other(axis)), name, control_unit)
    return fields | {"note": "; ".join([note, *filter(None, [fields.get("note")])])}


def _other(axis: str) -> str:
    """Name of the copy of a single axis."""
    return "X" if axis == "Y" else "Y"


def _result(
    flags: Identify, log: Log, source: str, machine: IdentifiedMachine
) -> LinearMachineResult:
    axes = [identified.axis_result(one) for one in machine.axes]
    limits = identified.largest(machine)
    encoders = f"Encoders: counts of {of_axes(identified.counts(machine), flags.axes)}"
    if noise := identified.noises(machine):
        encoders += f"; noise beside them of {of_axes(noise, flags.axes)} RMS"
    coarse = usual.coarse_counts(
        machine.record.axes, np.array([one.resolution for one in machine.axes])
    )
    named = "If so, name the columns as x_position_um, or give --length-unit um"
    lengths = _questions(flags, axes, limits)
    lengths += [f"{line} {named}" for line in coarse]
    lengths += _tiny(flags, machine)
    masses = []
    if flags.force_constant is not None:
        turns = log.angles or (False,) * len(machine.axes)
        each = zip(machine.axes, turns, strict=True)
        masses = [identified.mass_words(one, flags.force_constant, rotary) for one, rotary in each]
    copied = []
    if len(flags.axes) == 1:
        (axis,), other = flags.axes, _other(flags.axes[0])
        copied.append(
            f"a contour needs two axes, so the machine file has {axis} twice: its {other} is a "
            f"copy that nobody measured. Record {other} too, or put its own numbers in"
        )
    return LinearMachineResult(
        data=source,
        words=[*log.words, encoders],
        samples=len(machine.record.command),
        dt=machine.record.dt,
        control_unit=flags.control_unit,
        axes=axes,
        limits=limits,
        gain=machine.gain,
        delay=machine.late,
        notes=[
            *_period(machine.record.dt),
            *([] if any(log.angles) else lengths),
            *copied,
            *masses,
            *machine.notes,
        ],
        model=MODEL,
    )


def _period(dt: float) -> list[str]:
    """A question where no drive has such a period."""
    if usual.SHORTEST <= dt <= usual.LONGEST:
        return []
    return [
        f"time: a sample every {1e3 * dt:g} ms is no usual period of a drive; is the unit of "
        "its column right? Call it time_ms or time_us, or give --period-ms"
    ]


def _questions(
    flags: Identify, axes: list[LinearAxisResult], largest: dict[str, list[float]]
) -> list[str]:
    """One line for each number that no machine has; most likely a unit is wrong."""
    return [
        f"{one.name}: {feed_words(speed)} and {moved / usual.GRAVITY:.3g} g in the record, and "
        f"{gain_words(one)} per {flags.control_unit}, are "
        "more than any drive has; is --length-unit right?"
        for one, speed, moved in zip(axes, largest["speed"], largest["acceleration"], strict=True)
        if speed > usual.FAST or moved > usual.HARD or abs(one.gain) > GAIN_ASKED
    ]


def _tiny(flags: Identify, machine: IdentifiedMachine) -> list[str]:
    """One line for each axis that hardly moves, on an encoder as fine as none: m taken for mm."""
    moved = np.ptp(machine.record.position, axis=0)
    return [
        f"{one.name}: moves by {1e3 * way:.3g} mm in all, by counts of "
        f"{1e9 * one.resolution:.3g} nm; are the positions in {flags.length_unit}? If not, give "
        "--length-unit"
        for one, way in zip(machine.axes, moved, strict=True)
        if way < TINY and one.resolution < FINE
    ]


def show(result: LinearMachineResult, console: Console) -> None:
    """Print the axes, the family and the warnings."""
    seconds = result.samples * result.dt
    tables.say(
        console,
        f"Data: {result.data}",
        f"Used: {result.samples} samples at {1 / result.dt:.5g} Hz, {seconds:.4g} s",
        *result.words,
    )
    title = f"Identified machine; gains are per {result.control_unit}"

    def spread(axis: LinearAxisResult) -> str:
        low, high = axis.gain_interval
        return f"{50 * (high - low) / abs(axis.gain) if axis.gain else float('nan'):.2g}"

    def shown(axis: LinearAxisResult) -> str:  # and the last measured line
        to = f"{axis.shown_to:.3g}" if np.isfinite(axis.shown_to) else "-"
        return f"{to} of {axis.measured_to:.3g}" if axis.measured_to else to

    columns: dict[str, Callable[[LinearAxisResult], str | float]] = {
        "axis": lambda axis: axis.name,
        "model": words_of,
        "gain at rest": gain_words,
        "+- %": spread,
        "delay": lambda axis: str(axis.delay),
        "explains %": lambda axis: f"{100 * axis.explained:.3f}",
        "left um": lambda axis: f"{1e6 * axis.innovation:.3g}",
        "shown to Hz": shown,
        "family %": lambda axis: f"{100 * axis.uncertainty:.2g}",
    }
    console.print(tables.table_of(title, result.axes, columns, text_columns=2))
    accelerations = ", ".join(f"{value:.3g}" for value in result.limits["acceleration"])
    commands = ", ".join(f"{value:.4g}" for value in result.limits["control"])
    late = f" and up to {result.delay} sample more of delay" if result.delay else ""
    tables.say(
        console,
        f"Family: every gain to {100 * result.gain:.2g} %{late}",
        f"Limits in the file, the largest of the record: {feed_words(*result.limits['speed'])}; "
        f"{accelerations} m/s^2; {commands} {result.control_unit}. "
        "Change them to those of the machine.",
        *(f"NOTE: {note}" for note in result.notes),
    )


def gain_words(one: LinearAxisResult) -> str:
    """Gain of an axis per control unit: a speed, or the position where it settles."""
    return feed_words(one.gain) if one.integrators else f"{1e3 * one.gain:.5g} mm"


def words_of(one: LinearAxisResult) -> str:
    """Poles of a model as an engineer says them."""
    parts = ["integrator"] if one.integrators else []
    parts += [f"{1e3 * value:.3g} ms" for value in one.time_constants]
    parts += [f"{hertz:.3g} Hz (damping {z:.2g})" for hertz, z in one.resonances]
    return ", ".join(parts) or "gain"
