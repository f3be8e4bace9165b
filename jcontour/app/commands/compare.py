"""Comparison of two runs of a command: what changed, and which is better where.

Numbers are compared where path, motion, unit and sample are the same.
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
    ContourRead,
    FamilyMetrics,
    RunMetrics,
)
from jcontour.app.files.results.stored import Weight, read_result
from jcontour.app.files.results.tuned_result import TunedContour, TunedResult
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports import tables
from jcontour.app.reports.screen import Entry
from jcontour.app.reports.tables import columns_of, digits

SAME = 1e-3  # relative: a smaller difference is called none
UNNAMED = "control unit"  # of a machine that does not say its unit
UNCOMPARED = ("json", "out", "resume", "rollouts")
NEITHER = "neither"  # is better: the smaller number is of a run with the verdict DO NOT USE
SIDES = ("first", "second", "same", NEITHER)
KINDS = {"tune": TunedResult, "simulate": SimulatedResult, "audit": AuditedResult}
Compared = TunedResult | SimulatedResult


@dataclass(frozen=True)
class ComparedMetric:
    """One metric of one contour in both runs, SI units; smaller is better.

    Attributes:
        training: whether the contour is for training, in either run.
        better: one of `SIDES`; empty where the numbers cannot be compared.
    """

    contour: str
    plant: str
    metric: str
    first: float
    second: float
    training: tuple[bool, bool]
    better: str


@dataclass(frozen=True, kw_only=True)
class ComparedResult:
    """Two runs side by side; every pair is first, second.

    Attributes:
        command: that made both, `tune` or `simulate`.
        machines: their names.
        settings, versions: those that differ.
        weights: None where a run has no such weight.
        verdicts: of the command on the weights.
        control_units: of the machines.
        sample_periods: [s].
        unlike: names of contours that both runs have, in another size or place.
        motions: how either run moves along contours that are the same path, but not the same
            motion.
        margins: largest spectral radius, delay margin, peak sensitivity; None where it is unknown.
        better: number of metrics in which either is better, both are the same, or neither is
            better as the one with the smaller number must not be used.
        cycle_times: of every contour that both runs have [s]; None where it is unknown.
    """

    command: str
    runs: list[str]
    machines: list[str]
    settings: dict[str, Any]
    versions: dict[str, Any]
    weights: dict[str, list[Weight]]
    verdicts: list[Verdict]
    control_units: list[str]
    sample_periods: list[float]
    unlike: list[str]
    motions: dict[str, list[str]]
    margins: dict[str, list[float | None]]
    metrics: list[ComparedMetric]
    better: dict[str, int]
    cycle_times: dict[str, list[float | None]]

    @property
    def usable(self) -> list[bool]:
        """Whether the weights of either run may be used."""
        return [verdict.usable for verdict in self.verdicts]

    @property
    def same_machine(self) -> bool:
        """Whether both runs are of one machine."""
        return self.machines[0] == self.machines[1]

    @property
    def alike(self) -> list[ComparedMetric]:
        """Metrics of the contours that are the same path and the same motion in both runs."""
        unlike = {*self.unlike, *self.motions}
        return [row for row in self.metrics if row.contour not in unlike]

    def units(self, metric: str) -> list[str]:
        """Unit of a metric in either run; of an increment with the sample where that differs."""
        if METRICS[metric].unit == CONTROL:
            return self.control_units
        if METRICS[metric].unit != INCREMENT:
            return ["um", "um"]
        if same_period(*self.sample_periods):
            return [f"{unit} per sample" for unit in self.control_units]
        both = zip(self.control_units, self.sample_periods, strict=True)
        return [f"{unit} per {digits(1e3 * period)} ms" for unit, period in both]


def run(first: Path, second: Path) -> ComparedResult:
    """Settings that differ, weights, and every metric of every contour that both runs have.

    Raises:
        RunError: a folder is not that of a finished run of `tune` or `simulate`, the commands of
            both differ, or a run is of an older version.
    """
    folders = (first, second)
    named = [str(run_folder.read_json(one, run_folder.SETTINGS).get("command")) for one in folders]
    alike = ("simulate", "audit") if named[0] in ("simulate", "audit") else ("tune",)
    commands = [one if one in alike else alike[0] for one in named]
    settings = [run_folder.opened(*pair) for pair in zip(folders, commands, strict=True)]
    a, b = (read_result(folder, KINDS[one]) for folder, one in zip(folders, commands, strict=True))
    unlike, motions = unlike_paths(a, b), unlike_motions(a, b)
    rows = _rows(a, b, [*unlike, *motions])
    margins = {}
    if isinstance(a, TunedResult) and isinstance(b, TunedResult):
        for name, margin in (
            ("largest_frozen_spectral_radius", "spectral_radius"),
            ("delay_samples", "delay_samples"),
            ("peak_sensitivity", "sensitivity"),
        ):
            margins[name] = [getattr(one.margins, margin) for one in (a, b)]
    times = {}
    for one, other in _pairs(a, b):
        times[one.name] = [None if c.read is None else c.read.duration for c in (one, other)]
    names = list(dict.fromkeys((*a.weights, *b.weights)))
    return ComparedResult(
        command=commands[0],
        runs=[str(folder) for folder in folders],
        machines=[a.machine.name, b.machine.name],
        settings=_changed([one["flags"] for one in settings], without=UNCOMPARED),
        versions=_changed([one.get("versions", {}) for one in settings]),
        weights={name: [a.weights.get(name), b.weights.get(name)] for name in names},
        verdicts=[a.verdict, b.verdict],
        control_units=control_units(a, b),
        sample_periods=[a.sample_period, b.sample_period],
        unlike=unlike,
        motions=motions,
        margins=margins,
        metrics=rows,
        better={side: sum(row.better == side for row in rows) for side in SIDES},
        cycle_times=times,
    )


def _contours(result: Compared) -> list[TunedContour]:
    """Contours of a run; of `simulate` its one, with the worst of its plants."""
    if isinstance(result, TunedResult):
        return result.contours
    plants = list(result.plants.values())
    worst = {
        one.name: np.max([getattr(plant, one.name) for plant in plants]).item()
        for one in fields(RunMetrics)
    }
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


def _pairs(first: Compared, second: Compared) -> list[tuple[TunedContour, TunedContour]]:
    """Contours that both runs have."""
    others = {contour.name: contour for contour in _contours(second)}
    return [(one, others[one.name]) for one in _contours(first) if one.name in others]


def unlike_paths(first: Compared, second: Compared) -> list[str]:
    """Names of contours that are not the same path in both runs, as those made for other parts."""
    return [a.name for a, b in _pairs(first, second) if _other_path(a.read, b.read)]


def _other_path(first: ContourRead | None, second: ContourRead | None) -> bool:
    """Whether length or box differ, beyond rounding."""
    if first is None or second is None:
        return False
    a, b = ([one.length, *one.low, *one.high] for one in (first, second))
    return len(a) != len(b) or not np.allclose(a, b, rtol=SAME, atol=SAME * first.length)


def unlike_motions(first: Compared, second: Compared) -> dict[str, list[str]]:
    """Motion in either run of every contour that is the same path, but not the same motion.

    Feed law or duration differ, by more than some samples' time.
    """
    slack = 2 * max(one.sample_period for one in (first, second))
    motions = {}
    for pair in _pairs(first, second):
        a, b = pair
        if _other_path(a.read, b.read):
            continue
        lasting = [None if one.read is None else one.read.duration for one in pair]
        laws = {one.feed_law for one in pair if one.feed_law}
        known = [float("nan") if time is None else time for time in lasting]
        apart = abs(known[0] - known[1]) > slack + SAME * abs(known[1])
        if len(laws) > 1 or apart:  # nothing is apart from what is not known
            motions[a.name] = [
                ", ".join(filter(None, [one.feed_law, "" if time is None else f"{time:.4g} s"]))
                or "-"
                for one, time in zip(pair, lasting, strict=True)
            ]
    return motions


def comparable(metric: str, first: Compared, second: Compared) -> bool:
    """Whether a metric has the same unit in both runs; an increment is one per sample."""
    if METRICS[metric].unit not in (CONTROL, INCREMENT):
        return True
    mine, other = control_units(first, second)
    same = METRICS[metric].unit == CONTROL or same_period(first.sample_period, second.sample_period)
    return mine == other and same


def control_units(first: Compared, second: Compared) -> list[str]:
    """Units of the controls; one without a name is that of its machine alone."""
    machines = [first.machine, second.machine]
    units = [machine.control_unit for machine in machines]
    if units == [UNNAMED, UNNAMED] and machines[0].name != machines[1].name:
        return [f"{UNNAMED} of {machine.name}" for machine in machines]
    return units


def same_period(first: float, second: float) -> bool:
    """Whether two sample periods [s] are equal."""
    return bool(np.isclose(first, second, rtol=1e-9, atol=0))


def _changed(both: Sequence[dict[str, Any]], without: Sequence[str] = ()) -> dict[str, list[Any]]:
    """Entries that differ between two dictionaries."""
    first, second = both
    keys = sorted({*first, *second} - set(without))
    pairs = {key: [first.get(key), second.get(key)] for key in keys}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def _rows(first: Compared, second: Compared, unlike: Sequence[str]) -> list[ComparedMetric]:
    """Every metric of every contour that both runs have, and which is better."""
    both_contour = first.error == second.error == "contour"
    metrics = columns_of("contour" if both_contour else "tracking")
    usable = [first.verdict.usable, second.verdict.usable]
    same_machine = first.machine.name == second.machine.name
    judged = {name for name in metrics if same_machine and comparable(name, first, second)}
    rows = []
    for pair in _pairs(first, second):
        name, training = pair[0].name, (pair[0].training, pair[1].training)
        for plant, metric in product(("nominal", "worst"), metrics):
            values = [getattr(getattr(one.metrics["tuned"], plant), metric) for one in pair]
            better = _better(*values, usable) if metric in judged and name not in unlike else ""
            rows.append(ComparedMetric(name, plant, metric, *values, training, better))
    return rows


def _better(first: float, second: float, usable: Sequence[bool]) -> str:
    """Side with the smaller number, if its weights may be used."""
    side = _smaller(first, second)
    return side if side == "same" or usable[SIDES.index(side)] else NEITHER


def _smaller(first: float, second: float) -> str:
    """Side with the smaller number; NaN is a run that diverged."""
    lost = [value != value for value in (first, second)]
    if any(lost):
        return "same" if all(lost) else ("second" if lost[0] else "first")
    if abs(first - second) <= SAME * max(abs(first), abs(second)):
        return "same"
    return "first" if first < second else "second"


def show(found: ComparedResult, console: Console) -> None:
    """Warnings, verdict of each run, two tables, and which is better for what."""
    tables.say(console, *(f"WARNING: {line}" for line in warnings(found)))
    for side, folder, verdict in zip(SIDES, found.runs, found.verdicts, strict=False):
        tables.say(console, f"{side}: {folder}", verdict.heading)
        tables.say(console, *(f"  because: {line}" for line in verdict.reasons))
    motions: dict[tuple[str, ...], list[str]] = {}
    for name, motion in found.motions.items():
        motions.setdefault(tuple(motion), []).append(name)
    pairs: dict[str, Sequence[Any]] = {
        "machine": found.machines,
        "control unit": found.control_units,
        "sample period ms": [1e3 * one for one in found.sample_periods],
        **{f"motion of {', '.join(names)}": pair for pair, names in motions.items()},
        **found.settings,
        **found.versions,
        **found.weights,
    }
    changes = [[key, _value(a), _value(b)] for key, (a, b) in pairs.items() if a != b]
    for name, pair in found.margins.items():
        changes.append([name.replace("_", " "), *map(digits, pair)])
    console.print(tables.plain_table("What changed", ["", "first", "second"], changes, 3))
    headings = ["contour", "plant", "metric", "first", "second", "better"]
    rows = []
    for row in found.metrics:
        metric, (first, second) = METRICS[row.metric], found.units(row.metric)
        if first == second:
            values = [digits(metric.factor * value) for value in (row.first, row.second)]
            heading = metric.heading.replace("\n", " ")
            rows.append([row.contour, row.plant, heading, *values, row.better])
    first, second = found.control_units
    units = f"; controls in {first}" if first == second else ""
    whose = "Tuned weights" if found.command == "tune" else "Runs"
    title = f"{whose} of both, smaller is better{units}"
    console.print(tables.plain_table(title, headings, rows, 3))
    tables.say(console, *better_for(found), recommendation(found))


def answer(found: ComparedResult) -> list[Entry]:
    """Which of both may be loaded, what is better where, and what makes them hard to compare."""
    return [
        Entry("Runs", f"first {found.runs[0]}, second {found.runs[1]}"),
        Entry("Load", recommendation(found)),
        *(Entry("Compared", line) for line in better_for(found)),
        *(Entry("Warning", line) for line in warnings(found)),
    ]


def _value(value: Any) -> str:
    """A setting, a version or a weight, as a reader writes it.

    >>> [_value(one) for one in (None, 1500.0, 88394212234.72179, ["a.ngc", "b.ngc"])]
    ['-', '1500', '8.839e+10', 'a.ngc b.ngc']
    """
    if value is None:
        return "-"
    if isinstance(value, float):
        return digits(value)
    return " ".join(map(_value, value)) if isinstance(value, list) else str(value)


def warnings(found: ComparedResult) -> list[str]:
    """Lines where the numbers are hard to compare."""
    lines = []
    if not found.same_machine:
        lines.append(
            f"the runs are of different machines, {' and '.join(found.machines)}: a smaller error "
            "does not mean better weights"
        )
    elif "plant" in found.settings:
        lines.append("the machine comes from different files: it may not be the same")
    if found.unlike:
        lines.append(
            f"{', '.join(found.unlike)}: not the same path in both runs, as held-out contours are "
            "made for the parts; their errors do not say which weights are better"
        )
    if found.motions:
        lines.append(
            f"{', '.join(found.motions)}: not the same motion in both runs; their errors do not "
            "say which weights are better"
        )
    for words, metric in (("controls", "rms_control"), ("changes of the control", "rms_increment")):
        first, second = found.units(metric)
        if first != second:
            lines.append(f"{words} are in {first} and in {second}: not compared")
    if "feed_mm_per_min" in found.settings or "acceleration" in found.settings:
        lines.append("feed or acceleration differ, and errors grow with both")
    return lines


def better_for(found: ComparedResult) -> list[str]:
    """One line each for error, control effort, robustness and time: what either run has."""
    lines = []
    for metric, words in (
        ("rms_contour_error", "RMS contour error"),
        ("rms_tracking_error", "RMS tracking error"),
        ("rms_increment", "RMS change of the control"),
    ):
        rows = [row for row in found.alike if (row.metric, row.plant) == (metric, "worst")]
        if rows:
            factor = METRICS[metric].factor
            a, b = (  # NaN where one diverged
                factor * float(np.max([getattr(row, side) for row in rows])) for side in SIDES[:2]
            )
            told = f"{words}, worst contour and plant"
            lines.append(_line(found, told, (a, b), found.units(metric)))
    a, b = found.margins.get("peak_sensitivity", (None, None))
    if a is not None and b is not None:
        lines.append(_line(found, "Peak sensitivity over the family", (a, b), ("", "")))
    for name, (a, b) in found.cycle_times.items():
        if a is None or b is None or name in found.unlike or _smaller(a, b) == "same":
            continue
        times = f"{digits(a)} against {digits(b)} s"
        lines.append(f"Cycle time of {name}: {times}: the {_smaller(a, b)} is quicker.")
    return lines


def _line(
    found: ComparedResult, words: str, values: tuple[float, float], units: Sequence[str]
) -> str:
    """Both numbers, and which is better where unit and machine are the same."""
    a, b = ("diverged" if value != value else digits(value) for value in values)
    first, second = units
    if first != second:
        return f"{words}: {a} {first} against {b} {second}: not to be compared."
    both = f"{words}: {a} against {b} {first}".rstrip()
    if not found.same_machine:
        return f"{both}, of different machines."
    side = _better(*values, found.usable)
    which = {
        "same": "the same",
        NEITHER: f"less in the {_smaller(*values)}, which must not be used",
    }.get(side, f"the {side} is better")
    return f"{both}: {which}."


def recommendation(found: ComparedResult) -> str:
    """Which weights may be loaded; what the command advised against is never recommended."""
    command, (first, second) = found.command, found.usable
    both = "Both may be loaded" if command == "tune" else "Both keep every stated limit"
    if not (first or second):
        return f"Load neither: `{command}` said DO NOT USE of both."
    if first != second:
        side, other = ("first", "second") if first else ("second", "first")
        return f"Only the {side} may be loaded: `{command}` said DO NOT USE of the {other}."
    if not found.metrics:
        return "The runs have no contour in common: there is nothing to compare."
    if not found.alike:
        return (
            "No contour is the same path and motion in both: "
            f"{command} both on one part, at one feed."
        )
    if not found.same_machine:
        return f"{both}, each on its own machine: neither is called better."
    return f"{both}: the lines above say which is better for what."
