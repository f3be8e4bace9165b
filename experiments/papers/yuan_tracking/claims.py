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
    SHARPNESSES,
    TASKS,
    Columns,
    Result,
)
from experiments.tables import Table, where
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


class TableRow(NamedTuple):
    """Row of Tables 3.1 and 3.2: measured on the test bench, or ours."""

    task: str
    name: str
    columns: Columns
    time_ms: float | None = None  # of computing per sample, in print


PUBLISHED = (
    TableRow("A", PI, Columns(4.002, 1.603, 6.556, 1.722, 2.556, 0.744), 0.026),
    TableRow("A", FILTERED, Columns(4.001, 1.596, 6.271, 1.695, 2.272, 0.707), 0.028),
    TableRow("A", LESO, Columns(3.963, 1.379, 8.953, 1.823, 6.910, 1.743), 0.027),
    TableRow("B", PI, Columns(3.358, 1.975, 3.552, 2.053, 0.830, 0.595), 0.0115),
    TableRow("B", FILTERED, Columns(3.344, 1.968, 3.535, 2.043, 0.551, 0.553), 0.0118),
    TableRow("B", LESO, Columns(4.044, 1.969, 11.758, 4.394, 9.105, 2.118), 0.0117),
)
Changes = dict[str, float]  # relative, of every column


def claims(result: Result, published: Sequence[TableRow] = PUBLISHED) -> Iterator[Claim]:
    """Statements of section 3.4.3, then of the smooth twin, which is ours, and of the beam."""
    excess = [
        (f"{ours} on {row.task}", _excess(result.columns[ours][row.task]), _excess(row.columns))
        for row in published
        for ours in OURS[row.name]
    ]
    lost = [where for where, ours, _ in excess if ours <= 0]
    worst = 1 + max(ours for _, ours, _ in excess)
    printed = 1 + max(theirs for *_, theirs in excess)
    words = f"largest error of the end effector up to {worst:.2f} x the motor's, "
    words += f"in print up to {printed:.2f} x" + (f"; not for {', '.join(lost)}" if lost else "")
    fares = _ordered(not lost, [pair for _, *pair in excess])
    yield Claim(SECTION, "the end effector vibrates more than the motor", words, fares)
    plain = {row.task: row.columns for row in published if row.name == PI}
    wanted = {(row.name, row.task): _changes(row.columns, plain[row.task]) for row in published}
    changes = {
        (name, task): _changes(columns, result.columns["cascade"][task])
        for name, by_task in result.columns.items()
        for task, columns in by_task.items()
    }
    notch = {task: changes["cascade-notch", task] for task in TASKS}
    several = [change for one in notch.values() for change in one.values()]
    yield Claim(
        SECTION,
        "the notch changes most metrics marginally",
        f"its metrics change by {100 * min(several):+.2f} to {100 * max(several):+.2f} %",
        verdict(max(map(abs, several)) < MARGINAL),
    )
    relief = [(notch[task]["def_max"], wanted[FILTERED, task]["def_max"]) for task in TASKS]
    words = zip(relief, TASKS, strict=True)
    yield Claim(
        SECTION,
        "the notch lowers the largest deformation by 11 % on task A, 33 % on task B",
        ", ".join(f"{100 * change:+.2f} % on task {task}" for (change, _), task in words),
        _ordered(all(change < 0 for change, _ in relief), relief),
    )
    for task, columns, claim, form in (
        (
            "A",
            ("em_max", "em_mean"),
            "the LESO improves the motor's largest and mean error on task A",
            "{:+.1f} % largest, {:+.1f} % mean",
        ),
        (
            "B",
            ("em_max", "ee_max", "ee_mean"),
            "the LESO worsens motor and end effector on task B",
            "motor {:+.1f} %, tool {:+.1f} % largest, {:+.1f} % mean",
        ),
    ):
        rows = {name: changes[name, task] for name in OURS[LESO]}
        printed = wanted[LESO, task]
        pairs = [(row[one], printed[one]) for row in rows.values() for one in columns]
        fares = _ordered(all(ours < 0 if task == "A" else ours > 0 for ours, _ in pairs), pairs)
        words = "; ".join(
            f"{name}: " + form.format(*(100 * row[one] for one in columns))
            for name, row in {**rows, "in print": printed}.items()
        )
        if task == "B" and fares is Verdict.NOT_REPRODUCED:
            words += "; the tool of the model hardly vibrates, that of the bench does"
        yield Claim(SECTION, claim, words, fares)
    yield from _ours_and_the_beam(result)


def _ordered(holds: bool, pairs: Iterable[Sequence[float]]) -> Verdict:
    """Verdict on an order of numbers: reproduced where each (ours, printed) is of one size."""
    if not holds:
        return Verdict.NOT_REPRODUCED
    sized = all(1 / SIZED <= ours / printed <= SIZED for ours, printed in pairs)
    return Verdict.REPRODUCED if sized else Verdict.SAME_ORDERING


def _excess(columns: Columns) -> float:
    """Largest error of the end effector over the motor's, less 1."""
    return columns.ee_max / columns.em_max - 1


def _changes(columns: Columns, plain: Columns) -> Changes:
    """Relative change of every column against the plain cascade."""
    return {column: getattr(columns, column) / getattr(plain, column) - 1 for column in COLUMNS}


def _ours_and_the_beam(result: Result) -> Iterator[Claim]:
    default = result.gap[SHARPNESSES.index(DEFAULT_SHARPNESS)]
    shrinks = bool(np.all(result.gap[-1] < result.gap[0]))
    words = f"{100 * default[0]:.3f} % on task A, {100 * default[1]:.3f} % on task B; "
    words += "smaller the sharper" if shrinks else "not smaller the sharper"
    yield Claim(
        "ours",
        "the smooth twin is within 3 % of the true axis in RMS end-effector error",
        words,
        verdict(shrinks and bool(default.max() <= LARGEST_GAP)),
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


HEADINGS = {
    "motor\nmax": "em_max",
    "motor\nmean": "em_mean",
    "tool\nmax": "ee_max",
    "tool\nmean": "ee_mean",
    "deform.\nmax": "def_max",
    "effort": "u_mean",
}


def tables(result: Result) -> Iterator[Table]:
    """Tables 3.1 and 3.2."""
    for task, number in zip(TASKS, ("3.1", "3.2"), strict=True):
        lines = []
        for row in where(PUBLISHED, task=task):
            ours = [(f"ours: {name}", result.columns[name][task]) for name in OURS[row.name]]
            lines += [row, *(TableRow(task, *one) for one in ours)]
        yield Table(
            f"Table {number}, task {task}: the test bench, and below each row our simulation "
            "of its model [mm, A, us per sample]",
            lines,
            {
                "case": "name",
                **{heading: f"columns.{name}:.3f" for heading, name in HEADINGS.items()},
                "time": lambda row: f"{1e3 * row.time_ms:.3g}" if row.time_ms else "-",
                "verdict": lambda row: Verdict.EXPERIMENTAL if row.time_ms else "",
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
