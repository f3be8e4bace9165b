"""`jcontour compare`: what changed between two tuned runs, and which is better where."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from experiments.files import run_folder
from experiments.files.results.stored import Weight, read_result, stored_as, to_json
from experiments.files.results.tuned_result import TunedContour, TunedResult
from experiments.flags.others import Compare
from experiments.reports import tables
from experiments.reports.tables import COLUMNS, columns_of, digits

UNCOMPARED = ("json", "out", "resume", "rollouts")
SAME = 1e-3  # relative: a smaller difference is called none
SIDES = ("first", "second", "same")
HEADINGS = {name: heading.replace("\n", " ") for name, heading, _ in COLUMNS}
FACTORS = {name: factor for name, _, factor in COLUMNS}


@dataclass(frozen=True)
class ComparedMetric:
    """One metric of one contour in both runs, SI units; smaller is better.

    Attributes:
        training: whether the contour is for training, in either run.
        better: "first", "second" or "same".
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
    """Two tuned runs side by side; every pair is first, second.

    Attributes:
        machines: their names.
        settings, versions: those that differ.
        weights: None where a run has no such weight.
        margins: largest spectral radius and delay margin.
        better: number of metrics in which either is better, or both are the same.
    """

    runs: list[str]
    machines: list[str]
    settings: dict[str, Any]
    versions: dict[str, Any]
    weights: dict[str, list[Weight]]
    margins: dict[str, list[float]] = stored_as("safety")
    metrics: list[ComparedMetric]
    better: dict[str, int]


def command(flags: Compare) -> int:
    """The whole command: compare, print, exit code."""
    found = run(flags.first, flags.second)
    if flags.json:
        print(run_folder.json_text(to_json(found)))
    else:
        show(found, tables.console_of())
    return 0


def run(first: Path, second: Path) -> ComparedResult:
    """Settings that differ, weights, and every metric of every contour that both runs have.

    Raises:
        RunError: a folder is not that of a finished tuning run, or of an older version.
    """
    folders = (first, second)
    settings = [run_folder.opened(folder, "tune") for folder in folders]
    a, b = (read_result(folder, TunedResult) for folder in folders)
    rows = _rows(a, b)
    names = list(dict.fromkeys((*a.weights, *b.weights)))
    return ComparedResult(
        runs=[str(folder) for folder in folders],
        machines=[a.machine.name, b.machine.name],
        settings=_changed([one["flags"] for one in settings], without=UNCOMPARED),
        versions=_changed([one.get("versions", {}) for one in settings]),
        weights={name: [a.weights.get(name), b.weights.get(name)] for name in names},
        margins={
            "largest_frozen_spectral_radius": [
                a.margins.spectral_radius,
                b.margins.spectral_radius,
            ],
            "delay_samples": [a.margins.delay_samples, b.margins.delay_samples],
        },
        metrics=rows,
        better={side: sum(row.better == side for row in rows) for side in SIDES},
    )


def _changed(both: Sequence[dict[str, Any]], without: Sequence[str] = ()) -> dict[str, list[Any]]:
    """Entries that differ between two dictionaries."""
    first, second = both
    keys = sorted({*first, *second} - set(without))
    pairs = {key: [first.get(key), second.get(key)] for key in keys}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def _rows(first: TunedResult, second: TunedResult) -> list[ComparedMetric]:
    others = {contour.name: contour for contour in second.contours}
    both_contour = first.error == second.error == "contour"
    metrics = [name for name, _, _ in columns_of("contour" if both_contour else "tracking")]
    return [
        _row(contour, others[contour.name], plant, metric)
        for contour in first.contours
        if contour.name in others
        for plant in ("nominal", "worst")
        for metric in metrics
    ]


def _row(first: TunedContour, second: TunedContour, plant: str, metric: str) -> ComparedMetric:
    both = (first, second)
    a, b = (getattr(getattr(one.metrics["tuned"], plant), metric) for one in both)
    training = (first.training, second.training)
    return ComparedMetric(first.name, plant, metric, a, b, training, _better(a, b))


def _better(first: float, second: float) -> str:
    """Side with the smaller number; NaN is a run that diverged."""
    lost = [value != value for value in (first, second)]
    if any(lost):
        return "same" if all(lost) else ("second" if lost[0] else "first")
    if abs(first - second) <= SAME * max(abs(first), abs(second)):
        return "same"
    return "first" if first < second else "second"


def show(found: ComparedResult, console: Console) -> None:
    """Two tables and one sentence."""
    changes = [
        [key, str(a), str(b)]
        for part in (found.settings, found.versions, found.weights)
        for key, (a, b) in part.items()
        if a != b
    ]
    for name, pair in found.margins.items():
        changes.append([name.replace("_", " "), *map(digits, pair)])
    console.print(tables.plain_table("What changed", ["", *found.runs], changes))
    headings = ["contour", "plant", "metric", "first", "second", "better"]
    rows = [_cells(row) for row in found.metrics]
    title = "Tuned weights of both, smaller is better"
    console.print(tables.plain_table(title, headings, rows, 3))
    tables.say(console, *warnings(found), sentence(found))


def _cells(row: ComparedMetric) -> list[str]:
    factor = FACTORS[row.metric]
    values = (digits(factor * value) for value in (row.first, row.second))
    return [row.contour, row.plant, HEADINGS[row.metric], *values, row.better]


def warnings(found: ComparedResult) -> list[str]:
    """Warnings where the numbers are hard to compare."""
    lines = []
    first, second = found.machines
    if first != second:
        lines.append(
            f"WARNING: the runs are of different machines, {first} and {second}: a smaller error "
            "does not mean better weights"
        )
    elif "plant" in found.settings:
        lines.append("WARNING: the machine comes from different files: it may not be the same")
    if "feed_mm_per_min" in found.settings or "acceleration" in found.settings:
        lines.append("WARNING: feed or acceleration differ, and errors grow with both")
    return lines


def sentence(found: ComparedResult) -> str:
    """Which run is better, in words."""
    if not found.metrics:
        return "The runs have no contour in common: there is nothing to compare."
    counts, total = found.better, len(found.metrics)
    if counts["first"] == counts["second"]:
        verdict = "Neither run is better"
    else:
        side = max(("first", "second"), key=lambda side: counts[side])
        name = found.runs[0] if side == "first" else found.runs[1]
        verdict = f"The {side} run, {name}, is better more often"
    return (
        f"{verdict}: of {total} numbers the first is smaller in {counts['first']}, the second in "
        f"{counts['second']}, and {counts['same']} are the same within 0.1 %."
    )
