"""Runs of a command side by side: what differs, every number, and which run has the least.

Numbers are ranked where path, motion, machine, unit and sample are the same in every run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.results.loop_results import AuditedResult, SimulatedResult
from jcontour.app.files.results.run_metrics import (
    CONTROL,
    INCREMENT,
    METRICS,
    FamilyMetrics,
    RunMetrics,
)
from jcontour.app.files.results.stored import read_result
from jcontour.app.files.results.tuned_result import TunedContour, TunedResult
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports import tables
from jcontour.app.reports.screen import Entry
from jcontour.app.reports.tables import columns_of, digits

SAME = 1e-3  # relative: a smaller difference is called none
KINDS = {"tune": TunedResult, "simulate": SimulatedResult, "audit": AuditedResult}
ALIKE = ({"tune"}, {"simulate", "audit"})  # commands whose runs are compared
NOT_SETTINGS = ("json", "out", "resume", "rollouts")
MS = "peak sensitivity Ms"
SHOWN = ("rms_contour_error", "rms_tracking_error", "rms_increment")  # on the screen


@dataclass(frozen=True)
class ComparedNumber:
    """A number of every run, in the unit that is shown; smaller is better."""

    name: str
    values: list[float | None]
    contour: str = ""  # of a metric
    plant: str = ""  # the nominal one, or the worst of the family
    least: str = ""  # number of the run with the least, "same", or empty where it is not ranked


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Runs side by side; every list has an entry for each run."""

    command: str  # of the first run
    runs: list[str]
    verdicts: list[Verdict]
    differing: dict[str, list[Any]]  # settings, versions and weights that differ
    numbers: list[ComparedNumber]
    warnings: list[str]  # why numbers are not ranked


def is_comparable(folders: Sequence[Path]) -> bool:
    """Whether all runs are of commands whose runs are compared."""
    commands = {run_folder.read_json(one, run_folder.SETTINGS).get("command") for one in folders}
    return any(commands <= alike for alike in ALIKE)


def comparison(folders: Sequence[Path]) -> Comparison:
    """Every number of every contour that all runs have.

    Raises:
        RunError: a folder is not that of a finished run, the commands differ, or a run is of an
            older version.
    """
    commands = [str(run_folder.read_json(one, run_folder.SETTINGS)["command"]) for one in folders]
    stored = [run_folder.opened(*pair) for pair in zip(folders, commands, strict=True)]
    results = [read_result(one, KINDS[name]) for one, name in zip(folders, commands, strict=True)]
    verdicts = [one.verdict for one in results]
    machines = [one.machine.name for one in results]
    units = [one.machine.control_unit for one in results]
    periods = [one.sample_period for one in results]
    same_machine, same_unit = len(set(machines)) == 1, len(set(units)) == 1
    same_period = np.allclose(periods, periods[0], rtol=1e-9, atol=0.0)
    settings = [one["flags"] | one.get("versions", {}) for one in stored]
    differing = {
        **_differing([{"machine": name} for name in machines]),
        **_differing([{"control unit": unit} for unit in units]),
        **_differing([{"sample period ms": 1e3 * period} for period in periods]),
        **_differing(settings, without=NOT_SETTINGS),
        **_differing([one.weights for one in results]),
    }
    warnings = []
    if not same_machine:
        words = "the runs are of different machines"
        warnings.append(f"{words}, {', '.join(machines)}: a smaller error is no better loop")
    elif "plant" in differing:
        warnings.append("the machine comes from different files: it may not be the same")
    if not same_unit:
        warnings.append(f"controls are in {', '.join(units)}: not ranked")
    elif not same_period:
        warnings.append("sample periods differ: changes of the control are not ranked")
    both = all(one.error == "contour" for one in results)
    metrics = columns_of("contour" if both else "tracking")
    ranked = {
        name: same_machine
        and (METRICS[name].unit not in (CONTROL, INCREMENT) or same_unit)
        and (METRICS[name].unit != INCREMENT or bool(same_period))
        for name in metrics
    }
    numbers, contours = [], [{one.name: one for one in _contours(result)} for result in results]
    for name in [name for name in contours[0] if all(name in one for one in contours)]:
        own = [one[name] for one in contours]
        why = _unlike(own, 2 * max(periods))
        if why:
            warnings.append(f"{name}: not the same {why} in every run; its numbers are not ranked")
        times = [None if one.read is None else one.read.duration for one in own]
        least = _least(times, verdicts, why != "path")
        numbers.append(ComparedNumber("cycle time s", times, name, least=least))
        for metric, plant in product(ranked, ("nominal", "worst")):
            runs = [getattr(one.metrics["tuned"], plant) for one in own]
            values = [METRICS[metric].factor * getattr(run, metric) for run in runs]
            least = _least(values, verdicts, ranked[metric] and not why)
            numbers.append(ComparedNumber(_heading(metric), values, name, plant, least))
    if not numbers:
        warnings.append("the runs have no contour in common: there is nothing to compare")
    margins = [one.margins for one in results if isinstance(one, TunedResult)]
    if len(margins) == len(results):
        peaks = [one.sensitivity for one in margins]
        least = _least(peaks, verdicts, same_machine)
        numbers.append(ComparedNumber(MS, peaks, least=least))
        numbers.append(ComparedNumber("delay samples", [one.delay_samples for one in margins]))
    return Comparison(
        command=commands[0],
        runs=[str(folder) for folder in folders],
        verdicts=verdicts,
        differing=differing,
        numbers=numbers,
        warnings=warnings,
    )


def _contours(result: TunedResult | SimulatedResult) -> list[TunedContour]:
    """Contours of a run; of `simulate` its one, with the worst of its plants."""
    if isinstance(result, TunedResult):
        return result.contours
    plants = list(result.plants.values())
    names = [one.name for one in fields(RunMetrics)]
    worst = {name: np.max([getattr(plant, name) for plant in plants]).item() for name in names}
    return [
        TunedContour(
            name=result.contour,
            training=False,
            samples=result.samples,
            metrics={"tuned": FamilyMetrics(plants[0], RunMetrics(**worst))},
            read=result.read,
            feed_law=result.feed_law,
        )
    ]


def _heading(metric: str) -> str:
    return f"{METRICS[metric].words} um" if METRICS[metric].unit == "m" else METRICS[metric].words


def _unlike(own: Sequence[TunedContour], slack: float) -> str:
    """Whether a contour is another path or another motion in any run; empty where it is neither.

    Length and box are equal beyond rounding; the feed law is the same, and the duration to within
    a slack [s].
    """
    first = own[0]
    for one in own[1:]:
        if first.feed_law and one.feed_law and first.feed_law != one.feed_law:
            return "motion"
        if first.read is None or one.read is None:
            continue
        a, b = ([read.length, *read.low, *read.high] for read in (first.read, one.read))
        size = first.read.length
        if len(a) != len(b) or not np.allclose(a, b, rtol=SAME, atol=SAME * size):
            return "path"
        time, other = first.read.duration, one.read.duration
        if time is not None and other is not None and abs(time - other) > slack + SAME * other:
            return "motion"
    return ""


def _least(values: Sequence[float | None], verdicts: Sequence[Verdict], ranked: bool) -> str:
    """Number of the run with the least of those that may be used, from 1; NaN is a lost run."""
    sizes = [np.inf if value is None or value != value else value for value in values]
    if not ranked or None in values or not np.isfinite(sizes).any():
        return ""
    if np.isfinite(sizes).all() and np.ptp(sizes) <= SAME * np.max(np.abs(sizes)):
        return "same"
    usable = [
        size if verdict.usable else np.inf for size, verdict in zip(sizes, verdicts, strict=True)
    ]
    return str(1 + int(np.argmin(usable))) if np.isfinite(usable).any() else ""


def _differing(each: Sequence[dict[str, Any]], without: Sequence[str] = ()) -> dict[str, list[Any]]:
    """Entries that are not the same in all dictionaries."""
    keys = dict.fromkeys(key for one in each for key in one if key not in without)
    rows = {key: [one.get(key) for one in each] for key in keys}
    return {key: row for key, row in rows.items() if any(value != row[0] for value in row)}


def show_comparison(compared: Comparison, console: Console) -> None:
    """Warnings, the verdict of each run, what differs, and every number."""
    tables.say(console, *(f"WARNING: {line}" for line in compared.warnings))
    for number, (folder, verdict) in enumerate(
        zip(compared.runs, compared.verdicts, strict=True), 1
    ):
        because = [f"  because: {line}" for line in verdict.reasons]
        tables.say(console, f"{number}: {folder}", verdict.heading, *because)
    heads = [str(number) for number in range(1, len(compared.runs) + 1)]
    rows = [[name, *map(_value, values)] for name, values in compared.differing.items()]
    if rows:
        console.print(tables.plain_table("What differs", ["", *heads], rows, 1 + len(heads)))
    numbers = [
        [one.contour, one.plant, one.name, *map(_value, one.values), one.least]
        for one in compared.numbers
    ]
    headings = ["contour", "plant", "number", *heads, "least"]
    console.print(tables.plain_table("Runs, smaller is better", headings, numbers, 3))


def comparison_answer(compared: Comparison) -> list[Entry]:
    """Every run in a line, what is least where, and what makes them hard to compare."""
    entries = []
    for number, (folder, verdict) in enumerate(
        zip(compared.runs, compared.verdicts, strict=True), 1
    ):
        entries.append(Entry(f"Run {number}", f"{folder}: {verdict.heading}"))
    rows: dict[str, list[list[float | None]]] = {name: [] for name in (*map(_heading, SHOWN), MS)}
    for one in compared.numbers:
        if one.name in rows and one.least and one.plant in ("", "worst"):
            rows[one.name].append(one.values)
    for name, values in rows.items():
        if values:  # the largest of all contours that are ranked
            largest = np.max(np.array(values, float), axis=0).tolist()
            least = _least(largest, compared.verdicts, True)
            which = {"": "", "same": ", the same"}.get(least, f", least in run {least}")
            sizes = " against ".join(map(_value, largest))
            entries.append(Entry("Compared", f"{name}, largest: {sizes}{which}"))
    return [*entries, *(Entry("Warning", line) for line in compared.warnings)]


def _value(value: Any) -> str:
    """A setting, a version, a weight or a number, as a reader writes it.

    >>> [_value(one) for one in (None, 1500.0, 88394212234.72179, ["a.ngc", "b.ngc"])]
    ['-', '1500', '8.839e+10', 'a.ngc b.ngc']
    """
    if value is None:
        return "-"
    if isinstance(value, float):
        return "diverged" if value != value else digits(value)
    return " ".join(map(_value, value)) if isinstance(value, list) else str(value)
