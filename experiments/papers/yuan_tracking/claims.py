"""Statements of Yuan's section 3.4.3 on tracking: verdicts, tables and figures."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_tracking.experiment import (
    KEPT_PERIOD,
    TASKS,
    Columns,
    Result,
)
from experiments.tables import Table
from jcontour.app.reports.figures.axes import CYCLE

PI, FILTERED, LESO = "Cascaded PI", "Cascaded PI with filter", "Cascaded PI with LESO"
OURS = {  # row of the thesis's tables -> ours; how its observer is sampled the thesis does not say
    PI: ("cascade",),
    FILTERED: ("cascade-notch",),
    LESO: ("cascade-leso-exact", "cascade-leso-euler", "cascade-leso"),
}
COLUMNS = tuple(column.name for column in fields(Columns))
SIZED = 2.0  # factor between our change and the printed one up to which their sizes match
MARGINAL = 0.1  # a change up to which an improvement is marginal
LARGEST_GAP = 0.03  # between the smooth twin at its default sharpness and the true axis
DEFAULT_SHARPNESS = 1e3  # [s/m]
SECTION = "section 3.4.3"


class PublishedRow(NamedTuple):
    """Row of Tables 3.1 and 3.2, measured on the test bench."""

    task: str
    name: str
    columns: Columns
    time_ms: float  # of computing per sample


PUBLISHED = (
    PublishedRow("A", PI, Columns(4.002, 1.603, 6.556, 1.722, 2.556, 0.744), 0.026),
    PublishedRow("A", FILTERED, Columns(4.001, 1.596, 6.271, 1.695, 2.272, 0.707), 0.028),
    PublishedRow("A", LESO, Columns(3.963, 1.379, 8.953, 1.823, 6.910, 1.743), 0.027),
    PublishedRow("B", PI, Columns(3.358, 1.975, 3.552, 2.053, 0.830, 0.595), 0.0115),
    PublishedRow("B", FILTERED, Columns(3.344, 1.968, 3.535, 2.043, 0.551, 0.553), 0.0118),
    PublishedRow("B", LESO, Columns(4.044, 1.969, 11.758, 4.394, 9.105, 2.118), 0.0117),
)
Published = Sequence[PublishedRow]


def claims(result: Result, published: Published = PUBLISHED) -> Iterator[Claim]:
    """Statements of section 3.4.3, then of the smooth twin, which is ours, and of the beam."""
    yield _tool_vibrates_more(result, published)
    by_task = {task: _changes(result, "cascade-notch", task) for task in TASKS}
    changes = [change for several in by_task.values() for change in several.values()]
    yield Claim(
        SECTION,
        "the notch changes most metrics marginally",
        f"its metrics change by {100 * min(changes):+.2f} to {100 * max(changes):+.2f} %",
        verdict(max(map(abs, changes)) < MARGINAL),
    )
    relief = {task: by_task[task]["def_max"] for task in TASKS}
    wanted = {task: _in_print(published, FILTERED, task)["def_max"] for task in TASKS}
    yield Claim(
        SECTION,
        "the notch lowers the largest deformation by 11 % on task A, 33 % on task B",
        ", ".join(f"{100 * change:+.2f} % on task {task}" for task, change in relief.items()),
        _ordered(
            all(change < 0 for change in relief.values()),
            [(relief[task], wanted[task]) for task in TASKS],
        ),
    )
    yield from _observer(result, published)
    default = next(row for row in result.gap if row.sharpness == DEFAULT_SHARPNESS)
    first, last = result.gap[0], result.gap[-1]
    shrinks = last.A < first.A and last.B < first.B
    words = f"{100 * default.A:.3f} % on task A, {100 * default.B:.3f} % on task B; "
    words += "smaller the sharper" if shrinks else "not smaller the sharper"
    yield Claim(
        "ours",
        "the smooth twin is within 3 % of the true axis in RMS end-effector error",
        words,
        verdict(shrinks and max(default.A, default.B) <= LARGEST_GAP),
    )
    beam = result.beam
    yield Claim(
        "Fig. 3.3",
        "the beam's first mode is within the bandwidth of usual cascades",
        f"by Euler and Bernoulli {beam.bare_hz[0]:.2f} Hz bare; with {beam.load_kg:.3f} kg at its "
        f"tip {beam.identified_hz:.2f} Hz, that of the identified link, whose stiffness is "
        f"{beam.stiffness:.2f} x 3EI/L^3. The text prints no frequency",
        Verdict.EXPERIMENTAL,
    )


def _ordered(holds: bool, pairs: Iterable[tuple[float, float]]) -> Verdict:
    """Verdict on an order of numbers: reproduced where each (ours, printed) is of one size."""
    if not holds:
        return Verdict.NOT_REPRODUCED
    sized = all(1 / SIZED <= ours / printed <= SIZED for ours, printed in pairs)
    return Verdict.REPRODUCED if sized else Verdict.SAME_ORDERING


def _excess(columns: Columns) -> float:
    """Largest error of the end effector over the motor's, less 1."""
    return columns.ee_max / columns.em_max - 1


def _tool_vibrates_more(result: Result, published: Published) -> Claim:
    ratios = [
        (f"{ours} on {row.task}", _excess(result.row(ours).on(row.task)), _excess(row.columns))
        for row in published
        for ours in OURS[row.name]
    ]
    lost = [where for where, excess, _ in ratios if excess <= 0]
    worst, printed = max(ours for _, ours, _ in ratios), max(wanted for *_, wanted in ratios)
    words = (
        f"largest error of the end effector up to {1 + worst:.2f} x the motor's, "
        f"in print up to {1 + printed:.2f} x"
    )
    if lost:
        words += f"; not for {', '.join(lost)}"
    fares = _ordered(not lost, [(excess, wanted) for _, excess, wanted in ratios])
    return Claim(SECTION, "the end effector vibrates more than the motor", words, fares)


def _changes(result: Result, name: str, task: str) -> dict[str, float]:
    """Relative change of every column against the plain cascade."""
    return _relative(result.row(name).on(task), result.row("cascade").on(task))


def _in_print(published: Published, name: str, task: str) -> dict[str, float]:
    """The same of the printed numbers."""
    rows = {(row.name, row.task): row.columns for row in published}
    return _relative(rows[name, task], rows[PI, task])


def _relative(columns: Columns, plain: Columns) -> dict[str, float]:
    return {column: getattr(columns, column) / getattr(plain, column) - 1 for column in COLUMNS}


def _observer(result: Result, published: Published) -> Iterator[Claim]:
    """The extended state observer: better on task A, worse on task B."""
    changes = {name: _changes(result, name, "A") for name in OURS[LESO]}
    wanted = _in_print(published, LESO, "A")
    pairs = _pairs(changes, wanted, ("em_max", "em_mean"))
    words = "; ".join(
        f"{name}: {100 * one['em_max']:+.1f} % largest, {100 * one['em_mean']:+.1f} % mean"
        for name, one in {**changes, "in print": wanted}.items()
    )
    fares = _ordered(all(ours < 0 for ours, _ in pairs), pairs)
    claim = "the LESO improves the motor's largest and mean error on task A"
    yield Claim(SECTION, claim, words, fares)
    changes = {name: _changes(result, name, "B") for name in OURS[LESO]}
    wanted = _in_print(published, LESO, "B")
    pairs = _pairs(changes, wanted, ("em_max", "ee_max", "ee_mean"))
    fares = _ordered(all(ours > 0 for ours, _ in pairs), pairs)
    words = "; ".join(
        f"{name}: motor {100 * change['em_max']:+.1f} %, tool {100 * change['ee_max']:+.1f} % "
        f"largest, {100 * change['ee_mean']:+.1f} % mean"
        for name, change in {**changes, "in print": wanted}.items()
    )
    if fares is Verdict.NOT_REPRODUCED:
        words += "; the tool of the model hardly vibrates, that of the bench does"
    yield Claim(SECTION, "the LESO worsens motor and end effector on task B", words, fares)


def _pairs(
    changes: dict[str, dict[str, float]], wanted: dict[str, float], columns: Sequence[str]
) -> list[tuple[float, float]]:
    """Our change and the printed one, of every form of the observer."""
    return [(change[one], wanted[one]) for change in changes.values() for one in columns]


HEADINGS = {
    "motor\nmax": "em_max",
    "motor\nmean": "em_mean",
    "tool\nmax": "ee_max",
    "tool\nmean": "ee_mean",
    "deform.\nmax": "def_max",
    "effort": "u_mean",
}


class Line(NamedTuple):
    """Line of Table 3.1 or 3.2: the paper's, and below it ours."""

    case: str
    columns: Columns
    time_us: float | None  # of computing, in print
    verdict: str


def tables(result: Result) -> Iterator[Table]:
    """Tables 3.1 and 3.2."""
    for task, number in zip(TASKS, ("3.1", "3.2"), strict=True):
        lines = []
        for row in PUBLISHED:
            if row.task == task:
                time = 1e3 * row.time_ms
                lines.append(Line(row.name, row.columns, time, Verdict.EXPERIMENTAL))
                for name in OURS[row.name]:
                    ours = result.row(name)
                    lines.append(Line(f"ours: {name}", ours.on(task), None, ""))
        yield Table(
            f"Table {number}, task {task}: the test bench, and below each row our simulation "
            "of its model [mm, A, us per sample]",
            lines,
            {
                "case": "case",
                **{heading: f"columns.{name}:.3f" for heading, name in HEADINGS.items()},
                "time": "time_us:.3g",
                "verdict": "verdict",
            },
        )


LABELS = {"cascade": "PI", "cascade-notch": "PI with filter", "cascade-leso-exact": "PI with LESO"}
# the first two are nearly the same: the wide line shows beneath the narrow one
STYLES = {
    "cascade": {"color": "tab:blue", "linewidth": 2.6, "alpha": 0.5},
    "cascade-notch": {"color": "tab:orange", "linewidth": 0.9},
    "cascade-leso-exact": {"color": "tab:green", "linewidth": 0.9},
}
SIDES = {"motor": "(a) motor", "tool": "(b) end effector"}


def over_time(result: Result, task: str, number: str, error: bool) -> Figure:
    """Figs 3.8 to 3.11: motor and end effector beside the reference, or their errors."""
    wanted = next(iter(result.signals.values()))[task].wanted
    time, panels = KEPT_PERIOD * np.arange(wanted.size), []
    for side, title in SIDES.items():
        curves = []
        for controller, tasks in result.signals.items():
            signal = getattr(tasks[task], side)
            values = 1e3 * (wanted - signal if error else signal)
            curves.append(Curve(time, values, LABELS[controller], STYLES[controller]))
        if not error:
            dashed = {"color": "0.3", "linewidth": 0.8, "linestyle": "--"}
            curves.append(Curve(time, 1e3 * wanted, "reference", dashed))
        y = "error [mm]" if error else "position [mm]"
        panels.append(Panel(title, "time [s]", y, curves, {"xmargin": 0.01}))
    kind = "tracking error" if error else "position"
    title = f"Fig. {number}: {kind}, task {task}"
    return drawn(panels, (8.0, 6.0), title, legend=4, sharex=True)


def beam(result: Result) -> Figure:
    """Fig. 3.3: modes of the beam."""
    study = result.beam
    curves = [
        Curve(study.place, shape, f"{hz:.4g} Hz", {"color": colour})
        for shape, hz, colour in zip(study.shapes, study.loaded_hz, CYCLE, strict=False)
    ]
    title = f"Fig. 3.3: modes of the beam with {study.load_kg:.3f} kg at its tip"
    x = "place along the beam, over its length"
    return drawn([Panel(title, x, "deflection", curves)], (6.0, 4.0))


FIGURES = {
    "figure-3-3": beam,
    "figure-3-8": partial(over_time, task="A", number="3.8", error=False),
    "figure-3-9": partial(over_time, task="A", number="3.9", error=True),
    "figure-3-10": partial(over_time, task="B", number="3.10", error=False),
    "figure-3-11": partial(over_time, task="B", number="3.11", error=True),
}
