"""Comparison of two runs of a command: what changed, and which is better where."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import (
    CONTROL,
    INCREMENT,
    METRICS,
    ContourRead,
    FamilyMetrics,
    MachineSummary,
    RunMetrics,
)
from jcontour.app.files.results.stored import Weight, read_result
from jcontour.app.files.results.tuned_result import PathMargins, TunedResult
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports import tables
from jcontour.app.reports.tables import columns_of, digits

SAME = 1e-3  # relative: a smaller difference is called none
UNNAMED = "control unit"  # of a machine that does not say its unit


@dataclass(frozen=True, kw_only=True)
class ComparableContour:
    """One contour of a run.

    Attributes:
        training: whether the weights were tuned on it.
        metrics: of the weights of the run.
        read: what the contour is; None in folders of older versions.
        feed_law: of the motion, in words; empty likewise.
    """

    name: str
    training: bool
    metrics: FamilyMetrics
    read: ContourRead | None = None
    feed_law: str = ""


@dataclass(frozen=True, kw_only=True)
class ComparableRun:
    """What a run of `tune` and one of `simulate` have in common.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        margins: None of `simulate`, which looks at none.
        sample_period: [s]; None in folders of older versions.
    """

    machine: MachineSummary
    error: str
    weights: dict[str, Weight]
    verdict: Verdict
    contours: list[ComparableContour]
    margins: PathMargins | None = None
    sample_period: float | None = None

    @classmethod
    def of_tuned(cls, result: TunedResult) -> "ComparableRun":
        """The tuned weights on all contours."""
        contours = [
            ComparableContour(
                name=one.name,
                training=one.training,
                metrics=one.metrics["tuned"],
                read=one.read,
                feed_law=one.feed_law,
            )
            for one in result.contours
        ]
        return cls(
            machine=result.machine,
            error=result.error,
            weights=result.weights,
            verdict=result.verdict,
            contours=contours,
            margins=result.margins,
            sample_period=result.sample_period,
        )

    @classmethod
    def of_simulated(cls, result: SimulatedResult) -> "ComparableRun":
        """The controller on its one contour."""
        contour = ComparableContour(
            name=result.contour,
            training=False,
            metrics=_over_family(list(result.plants.values())),
            read=result.read,
            feed_law=result.feed_law,
        )
        return cls(
            machine=result.machine,
            error=result.error,
            weights=result.weights,
            verdict=result.verdict,
            contours=[contour],
            sample_period=result.sample_period,
        )


def _over_family(plants: list[RunMetrics]) -> FamilyMetrics:
    """The nominal plant, which is the first, and the worst of all metric by metric."""
    worst = {name: np.max([getattr(plant, name) for plant in plants]).item() for name in METRICS}
    return FamilyMetrics(plants[0], RunMetrics(**worst))


def unlike_paths(first: ComparableRun, second: ComparableRun) -> list[str]:
    """Names of contours that are not the same path in both runs, as those made for other parts."""
    return [a.name for a, b in _pairs(first, second) if _other_path(a.read, b.read)]


def unlike_motions(first: ComparableRun, second: ComparableRun) -> dict[str, list[str]]:
    """Motion in either run of every contour that is the same path, but not the same motion."""
    slack = 2 * max(one.sample_period or 0.0 for one in (first, second))
    found = {}
    for a, b in _pairs(first, second):
        if not _other_path(a.read, b.read) and _other_motion(a, b, slack):
            found[a.name] = [_motion_words(one) for one in (a, b)]
    return found


def comparable(metric: str, first: ComparableRun, second: ComparableRun) -> bool:
    """Whether a metric has the same unit in both runs; an increment is one per sample."""
    mine, other = control_units(first, second)
    units = mine == other
    if METRICS[metric].unit == INCREMENT:
        return units and same_period(first.sample_period, second.sample_period)
    return units or METRICS[metric].unit != CONTROL


def control_units(first: ComparableRun, second: ComparableRun) -> list[str]:
    """Units of the controls; one without a name is that of its machine alone."""
    machines = [first.machine, second.machine]
    units = [machine.control_unit for machine in machines]
    if units == [UNNAMED, UNNAMED] and machines[0].name != machines[1].name:
        return [f"{UNNAMED} of {machine.name}" for machine in machines]
    return units


def same_period(first: float | None, second: float | None) -> bool:
    """Whether two sample periods [s] are equal; one that is not known is taken to be."""
    return first is None or second is None or bool(np.isclose(first, second, rtol=1e-9, atol=0))


def _pairs(
    first: ComparableRun, second: ComparableRun
) -> Iterator[tuple[ComparableContour, ComparableContour]]:
    others = {contour.name: contour for contour in second.contours}
    return ((one, others[one.name]) for one in first.contours if one.name in others)


def _other_path(first: ContourRead | None, second: ContourRead | None) -> bool:
    """Whether length or box differ, beyond rounding."""
    if first is None or second is None:
        return False
    a, b = ([one.length, *one.low, *one.high] for one in (first, second))
    return len(a) != len(b) or not np.allclose(a, b, rtol=SAME, atol=SAME * first.length)


def _other_motion(first: ComparableContour, second: ComparableContour, slack: float) -> bool:
    """Whether feed law or duration differ, by more than some samples' time [s]."""
    if first.feed_law and second.feed_law and first.feed_law != second.feed_law:
        return True
    a, b = (None if one.read is None else one.read.duration for one in (first, second))
    return a is not None and b is not None and not np.isclose(a, b, rtol=SAME, atol=slack)


def _motion_words(contour: ComparableContour) -> str:
    """Feed law and duration, as far as they are known."""
    duration = None if contour.read is None else contour.read.duration
    lasting = "" if duration is None else f"{duration:.4g} s"
    return ", ".join(filter(None, [contour.feed_law, lasting])) or "-"


UNCOMPARED = ("json", "out", "resume", "rollouts")
NEITHER = "neither"  # is better: the smaller number is of a run with the verdict DO NOT USE
SIDES = ("first", "second", "same", NEITHER)


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
        sample_periods: [s]; None of a run of an older version.
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
    sample_periods: list[float | None]
    unlike: list[str]
    motions: dict[str, list[str]]
    margins: dict[str, list[float | None]]
    metrics: list[ComparedMetric]
    better: dict[str, int]
    cycle_times: dict[str, list[float | None]]


def run(first: Path, second: Path) -> ComparedResult:
    """Settings that differ, weights, and every metric of every contour that both runs have.

    Raises:
        RunError: a folder is not that of a finished run of `tune` or `simulate`, the commands of
            both differ, or a run is of an older version.
    """
    folders = (first, second)
    command = _command(first)
    settings = [run_folder.opened(folder, command) for folder in folders]
    a, b = (_read(folder, command) for folder in folders)
    unlike, motions = unlike_paths(a, b), unlike_motions(a, b)
    rows = _rows(a, b, [*unlike, *motions])
    names = list(dict.fromkeys((*a.weights, *b.weights)))
    return ComparedResult(
        command=command,
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
        margins=_margins(a, b),
        metrics=rows,
        better={side: sum(row.better == side for row in rows) for side in SIDES},
        cycle_times=_cycle_times(a, b),
    )


def _command(folder: Path) -> str:
    """`simulate` of a run of that command, else `tune`, which the second folder needs, too."""
    named = run_folder.read_json(folder, run_folder.SETTINGS).get("command")
    return "simulate" if named == "simulate" else "tune"


def _read(folder: Path, command: str) -> ComparableRun:
    if command == "tune":
        return ComparableRun.of_tuned(read_result(folder, TunedResult))
    return ComparableRun.of_simulated(read_result(folder, SimulatedResult))


def _margins(first: ComparableRun, second: ComparableRun) -> dict[str, list[float | None]]:
    """Margins of both; none of `simulate`."""
    a, b = first.margins, second.margins
    if a is None or b is None:
        return {}
    return {
        "largest_frozen_spectral_radius": [a.spectral_radius, b.spectral_radius],
        "delay_samples": [a.delay_samples, b.delay_samples],
        "peak_sensitivity": [a.sensitivity, b.sensitivity],
    }


def _cycle_times(first: ComparableRun, second: ComparableRun) -> dict[str, list[float | None]]:
    """Durations of the contours that both runs have."""
    a, b = (
        {one.name: None if one.read is None else one.read.duration for one in run.contours}
        for run in (first, second)
    )
    return {name: [a[name], b[name]] for name in a if name in b}


def _changed(both: Sequence[dict[str, Any]], without: Sequence[str] = ()) -> dict[str, list[Any]]:
    """Entries that differ between two dictionaries."""
    first, second = both
    keys = sorted({*first, *second} - set(without))
    pairs = {key: [first.get(key), second.get(key)] for key in keys}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def _rows(
    first: ComparableRun, second: ComparableRun, unlike: Sequence[str]
) -> list[ComparedMetric]:
    others = {contour.name: contour for contour in second.contours}
    both_contour = first.error == second.error == "contour"
    metrics = columns_of("contour" if both_contour else "tracking")
    units = {metric: comparable(metric, first, second) for metric in metrics}
    usable, alike = (
        (first.verdict.usable, second.verdict.usable),
        first.machine.name == second.machine.name,
    )
    rows = []
    for contour in first.contours:
        if contour.name not in others:
            continue
        for plant, metric in product(("nominal", "worst"), metrics):
            judged = usable if alike and units[metric] and contour.name not in unlike else None
            rows.append(_row(contour, others[contour.name], plant, metric, judged))
    return rows


def _row(
    first: ComparableContour,
    second: ComparableContour,
    plant: str,
    metric: str,
    usable: Sequence[bool] | None,
) -> ComparedMetric:
    """Both numbers, and which is better where the weights that may be used are told."""
    both = (first, second)
    a, b = (getattr(getattr(one.metrics, plant), metric) for one in both)
    training = (first.training, second.training)
    better = "" if usable is None else _better(a, b, usable)
    return ComparedMetric(first.name, plant, metric, a, b, training, better)


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
    tables.say(console, *warnings(found))
    for side, folder, verdict in zip(SIDES, found.runs, found.verdicts, strict=False):
        tables.say(console, f"{side}: {folder}", verdict.heading)
        tables.say(console, *(f"  because: {line}" for line in verdict.reasons))
    changes = [
        [key, _value(a), _value(b)]
        for part in (_machines(found), found.settings, found.versions, found.weights)
        for key, (a, b) in part.items()
        if a != b
    ]
    for name, pair in found.margins.items():
        changes.append([name.replace("_", " "), *map(digits, pair)])
    table = tables.plain_table("What changed", ["", "first", "second"], changes, 3)
    console.print(table)
    headings = ["contour", "plant", "metric", "first", "second", "better"]
    shown = [row for row in found.metrics if _has_one_unit(row.metric, found)]
    rows = [_cells(row) for row in shown]
    first, second = found.control_units
    units = f"; controls in {first}" if first == second else ""
    whose = "Tuned weights" if found.command == "tune" else "Runs"
    title = f"{whose} of both, smaller is better{units}"
    console.print(tables.plain_table(title, headings, rows, 3))
    tables.say(console, *better_for(found), recommendation(found))


def _machines(found: ComparedResult) -> dict[str, Sequence[Any]]:
    """Machine, units and motions of both runs."""
    periods = [None if one is None else 1e3 * one for one in found.sample_periods]
    pairs: dict[str, Sequence[Any]] = {
        "machine": found.machines,
        "control unit": found.control_units,
        "sample period ms": periods,
    }
    together: dict[tuple[str, ...], list[str]] = {}
    for name, motion in found.motions.items():
        together.setdefault(tuple(motion), []).append(name)
    return pairs | {f"motion of {', '.join(names)}": pair for pair, names in together.items()}


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


def _has_one_unit(metric: str, found: ComparedResult) -> bool:
    """Whether the numbers of both runs have the same unit; an error is in um."""
    if METRICS[metric].unit not in (CONTROL, INCREMENT):
        return True
    first, second = _units(metric, found)
    return first == second


def _cells(row: ComparedMetric) -> list[str]:
    factor = METRICS[row.metric].factor
    values = [digits(factor * value) for value in (row.first, row.second)]
    return [
        row.contour,
        row.plant,
        METRICS[row.metric].heading.replace("\n", " "),
        *values,
        row.better,
    ]


def _units(metric: str, found: ComparedResult) -> list[str]:
    """Unit of a control or its increment in either run, with the sample where that differs."""
    if METRICS[metric].unit != INCREMENT:
        return found.control_units
    if same_period(*found.sample_periods):
        return [f"{unit} per sample" for unit in found.control_units]
    both = zip(found.control_units, found.sample_periods, strict=True)
    return [f"{unit} per {digits(1e3 * (period or 0))} ms" for unit, period in both]


def warnings(found: ComparedResult) -> list[str]:
    """Warnings where the numbers are hard to compare."""
    lines = []
    first, second = found.machines
    if not _same_machine(found):
        lines.append(
            f"WARNING: the runs are of different machines, {first} and {second}: a smaller error "
            "does not mean better weights"
        )
    elif "plant" in found.settings:
        lines.append("WARNING: the machine comes from different files: it may not be the same")
    if found.unlike:
        lines.append(
            f"WARNING: {', '.join(found.unlike)}: not the same path in both runs, as held-out "
            "contours are made for the parts; their errors do not say which weights are better"
        )
    if found.motions:
        lines.append(
            f"WARNING: {', '.join(found.motions)}: not the same motion in both runs; their errors "
            "do not say which weights are better"
        )
    for words, metric in (("controls", "rms_control"), ("changes of the control", "rms_increment")):
        first, second = _units(metric, found)
        if first != second:
            lines.append(f"WARNING: {words} are in {first} and in {second}: not compared")
    if "feed_mm_per_min" in found.settings or "acceleration" in found.settings:
        lines.append("WARNING: feed or acceleration differ, and errors grow with both")
    return lines


def better_for(found: ComparedResult) -> list[str]:
    """One line each for error, control effort and robustness: what either run has."""
    lines, usable, alike = [], _usable(found), _same_machine(found)
    compared = [
        ("rms_contour_error", "RMS contour error", ("um", "um")),
        ("rms_tracking_error", "RMS tracking error", ("um", "um")),
        ("rms_increment", "RMS change of the control", _units("rms_increment", found)),
    ]
    for metric, words, units in compared:
        rows = [row for row in _alike(found) if (row.metric, row.plant) == (metric, "worst")]
        if rows:
            a, b = (METRICS[metric].factor * _largest(rows, side) for side in SIDES[:2])
            told = f"{words}, worst contour and plant"
            lines.append(_line(told, (a, b), units, usable, alike))
    a, b = found.margins.get("peak_sensitivity", (None, None))
    if a is not None and b is not None:
        lines.append(_line("Peak sensitivity over the family", (a, b), ("", ""), usable, alike))
    return [*lines, *_quicker(found)]


def _quicker(found: ComparedResult) -> list[str]:
    """A line for every contour whose cycle times differ, of the same path."""
    lines = []
    for name, (a, b) in found.cycle_times.items():
        if a is None or b is None or name in found.unlike or _smaller(a, b) == "same":
            continue
        times = f"{digits(a)} against {digits(b)} s"
        lines.append(f"Cycle time of {name}: {times}: the {_smaller(a, b)} is quicker.")
    return lines


def _usable(found: ComparedResult) -> list[bool]:
    return [verdict.usable for verdict in found.verdicts]


def _same_machine(found: ComparedResult) -> bool:
    first, second = found.machines
    return first == second


def _alike(found: ComparedResult) -> list[ComparedMetric]:
    """Rows of the contours that are the same path and the same motion in both runs."""
    unlike = {*found.unlike, *found.motions}
    return [row for row in found.metrics if row.contour not in unlike]


def _largest(rows: Sequence[ComparedMetric], side: str) -> float:
    values = [getattr(row, side) for row in rows]
    lost = any(value != value for value in values)
    return float("nan") if lost else max(values)


def _line(
    words: str,
    values: tuple[float, float],
    units: Sequence[str],
    usable: Sequence[bool],
    alike: bool,
) -> str:
    """Both numbers, and which is better where unit and machine are the same."""
    a, b = ("diverged" if value != value else digits(value) for value in values)
    first, second = units
    if first != second:
        return f"{words}: {a} {first} against {b} {second}: not to be compared."
    if not alike:
        return f"{words}: {a} against {b} {first}".rstrip() + ", of different machines."
    side = _better(*values, usable)
    which = {
        "same": "the same",
        NEITHER: f"less in the {_smaller(*values)}, which must not be used",
    }.get(side, f"the {side} is better")
    return f"{words}: {a} against {b} {first}".rstrip() + f": {which}."


def recommendation(found: ComparedResult) -> str:
    """Which weights may be loaded; what the command advised against is never recommended."""
    command, (first, second) = found.command, _usable(found)
    both = "Both may be loaded" if command == "tune" else "Both keep every stated limit"
    if not (first or second):
        return f"Load neither: `{command}` said DO NOT USE of both."
    if first != second:
        side, other = ("first", "second") if first else ("second", "first")
        return f"Only the {side} may be loaded: `{command}` said DO NOT USE of the {other}."
    if not found.metrics:
        return "The runs have no contour in common: there is nothing to compare."
    if not _alike(found):
        return (
            "No contour is the same path and motion in both: "
            f"{command} both on one part, at one feed."
        )
    if not _same_machine(found):
        return f"{both}, each on its own machine: neither is called better."
    return f"{both}: the lines above say which is better for what."
