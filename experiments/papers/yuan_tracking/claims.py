"""Statements of Yuan's section 3.4.3 on tracking, targets of the tuner, and the verdicts."""

from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import NamedTuple

from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_tracking.result import (
    TASKS,
    Columns,
    FamilyRow,
    GapRow,
    RankingRow,
    Result,
    TableRow,
    TimedColumns,
)

OURS = {  # row of the thesis's tables -> ours; how its observer is sampled the thesis does not say
    "Cascaded PI": ("cascade",),
    "Cascaded PI with filter": ("cascade-notch",),
    "Cascaded PI with LESO": ("cascade-leso-exact", "cascade-leso-euler", "cascade-leso"),
}
LESO = "Cascaded PI with LESO"
OBSERVERS = OURS[LESO]
COLUMNS = tuple(column.name for column in fields(Columns))
SIZED = 2.0  # factor between our change and the printed one up to which their sizes match
MARGINAL = 0.1  # a change up to which an improvement is marginal
LARGEST_GAP = 0.03  # between the smooth twin at its default sharpness and the true axis
DEFAULT_SHARPNESS = 1e3  # [s/m]
# mean end-effector error on task A over that of the thesis's gains
TARGETS = {"cascade": 0.6, "cascade-feedforward": 0.15}
MOST_CURRENT = 1.2  # over that of the thesis's gains
SECTION = "section 3.4.3"


class PublishedRow(NamedTuple):
    """Row of Tables 3.1 and 3.2, measured on the test bench."""

    task: str
    name: str
    columns: Columns
    time_ms: float  # of computing per sample


def row_of(rows: Sequence[RankingRow], controller: str, gains: str = "start") -> RankingRow:
    """The one row of a controller.

    Raises:
        KeyError: it has not been run.
    """
    for row in rows:
        if (row.controller, row.gains) == (controller, gains):
            return row
    raise KeyError(f"{controller}, {gains}")


def table_rows(
    published: Sequence[PublishedRow], ranking: Sequence[RankingRow]
) -> tuple[TableRow, ...]:
    """Rows of Tables 3.1 and 3.2 with ours beside them: measurements, shown and not matched."""
    found = []
    for row in published:
        ours = {name: _timed(row_of(ranking, name), row.task) for name in OURS[row.name]}
        found.append(
            TableRow(row.task, row.name, Verdict.EXPERIMENTAL, row.columns, row.time_ms, ours)
        )
    return tuple(found)


def claims(result: Result, confirmed: Sequence[str]) -> tuple[Claim, ...]:
    """Statements of section 3.4.3, then our own targets for the twin and for tuned controllers."""
    ranking = result.ranking
    tuned = {row.controller for row in ranking if row.gains == "tuned"}
    return (
        _tool_vibrates_more(result),
        _filter_is_marginal(ranking),
        _filter_relieves_the_link(result),
        _observer_on_task_a(result),
        _observer_on_task_b(result),
        _twin(result.gap),
        *(_target(ranking, name) for name in confirmed if name in tuned),
    )


def _timed(row: RankingRow, task: str) -> TimedColumns:
    metrics = row.on(task)
    return TimedColumns(**{c: getattr(metrics, c) for c in COLUMNS}, time_us=row.time_us)


def _ordered(holds: bool, pairs: Iterable[tuple[float, float]]) -> Verdict:
    """Verdict on an order of numbers: reproduced where each (ours, printed) is of one size."""
    if not holds:
        return Verdict.NOT_REPRODUCED
    sized = all(1 / SIZED <= ours / printed <= SIZED for ours, printed in pairs)
    return Verdict.REPRODUCED if sized else Verdict.SAME_ORDERING


def _in_print(result: Result, name: str, task: str) -> dict[str, float]:
    """Printed relative change of every column against the plain cascade."""
    rows = {(row.name, row.task): row.paper for row in result.tables}
    found, plain = rows[name, task], rows["Cascaded PI", task]
    return {column: getattr(found, column) / getattr(plain, column) - 1 for column in COLUMNS}


def _excess(found: Columns) -> float:
    """Largest error of the end effector over the motor's, less 1."""
    return found.ee_max / found.em_max - 1


def _tool_vibrates_more(result: Result) -> Claim:
    found = [
        (f"{ours} on {row.task}", _excess(columns), _excess(row.paper))
        for row in result.tables
        for ours, columns in row.ours.items()
    ]
    lost = [where for where, excess, _ in found if excess <= 0]
    worst, printed = max(ours for _, ours, _ in found), max(wanted for *_, wanted in found)
    words = (
        f"largest error of the end effector up to {1 + worst:.2f} x the motor's, "
        f"in print up to {1 + printed:.2f} x"
    )
    if lost:
        words += f"; not for {', '.join(lost)}"
    fares = _ordered(not lost, [(excess, wanted) for _, excess, wanted in found])
    return Claim(SECTION, "the end effector vibrates more than the motor", words, fares)


def _changes(rows: Sequence[RankingRow], name: str, task: str) -> dict[str, float]:
    """Relative change of every column against the plain cascade."""
    ours, plain = row_of(rows, name).on(task), row_of(rows, "cascade").on(task)
    return {column: getattr(ours, column) / getattr(plain, column) - 1 for column in COLUMNS}


def _filter_is_marginal(rows: Sequence[RankingRow]) -> Claim:
    by_task = [_changes(rows, "cascade-notch", task) for task in TASKS]
    changes = [change for found in by_task for change in found.values()]
    words = f"its metrics change by {100 * min(changes):+.2f} to {100 * max(changes):+.2f} %"
    holds = max(map(abs, changes)) < MARGINAL
    return Claim(SECTION, "the notch changes most metrics marginally", words, verdict(holds))


def _filter_relieves_the_link(result: Result) -> Claim:
    found = {task: _changes(result.ranking, "cascade-notch", task)["def_max"] for task in TASKS}
    wanted = {task: _in_print(result, "Cascaded PI with filter", task)["def_max"] for task in TASKS}
    words = ", ".join(f"{100 * change:+.2f} % on task {task}" for task, change in found.items())
    claim = "the notch lowers the largest deformation by 11 % on task A, 33 % on task B"
    pairs = [(found[task], wanted[task]) for task in TASKS]
    fares = _ordered(all(change < 0 for change in found.values()), pairs)
    return Claim(SECTION, claim, words, fares)


def _observer_on_task_a(result: Result) -> Claim:
    columns, wanted = ("em_max", "em_mean"), _in_print(result, LESO, "A")
    found = {name: _changes(result.ranking, name, "A") for name in OBSERVERS}
    words = "; ".join(
        f"{name}: {100 * change['em_max']:+.1f} % largest, {100 * change['em_mean']:+.1f} % mean"
        for name, change in {**found, "in print": wanted}.items()
    )
    claim = "the LESO improves the motor's largest and mean error on task A"
    pairs = [(change[one], wanted[one]) for change in found.values() for one in columns]
    return Claim(SECTION, claim, words, _ordered(all(ours < 0 for ours, _ in pairs), pairs))


def _observer_on_task_b(result: Result) -> Claim:
    columns, wanted = ("em_max", "ee_max", "ee_mean"), _in_print(result, LESO, "B")
    found = {name: _changes(result.ranking, name, "B") for name in OBSERVERS}
    words = "; ".join(
        f"{name}: motor {100 * change['em_max']:+.1f} %, tool {100 * change['ee_max']:+.1f} % "
        f"largest, {100 * change['ee_mean']:+.1f} % mean"
        for name, change in {**found, "in print": wanted}.items()
    )
    claim = "the LESO worsens motor and end effector on task B"
    pairs = [(change[one], wanted[one]) for change in found.values() for one in columns]
    fares = _ordered(all(ours > 0 for ours, _ in pairs), pairs)
    if fares is Verdict.NOT_REPRODUCED:
        words += "; the tool of the model hardly vibrates, that of the bench does"
    return Claim(SECTION, claim, words, fares)


def _twin(gap: Sequence[GapRow]) -> Claim:
    default = next(row for row in gap if row.sharpness == DEFAULT_SHARPNESS)
    shrinks = all(gap[-1].on(task) < gap[0].on(task) for task in TASKS)
    words = f"{100 * default.A:.3f} % on task A, {100 * default.B:.3f} % on task B; "
    words += "smaller the sharper" if shrinks else "not smaller the sharper"
    claim = "the smooth twin is within 3 % of the true axis in RMS end-effector error"
    holds = shrinks and max(default.A, default.B) <= LARGEST_GAP
    return Claim("ours", claim, words, verdict(holds))


def _target(rows: Sequence[RankingRow], name: str) -> Claim:
    """Tuned gains against the thesis's on the same plant: both tasks, nominal and off by 20 %."""
    before = {(row.task, row.plant): row for row in row_of(rows, "cascade").family}
    ratios: dict[tuple[str, str], float] = {}
    currents: dict[tuple[str, str], float] = {}
    for member in row_of(rows, name, "tuned").family:
        key = (member.task, member.plant)
        ratios[key], currents[key] = _over(member, before[key])
    most = TARGETS[name]
    task, plant = worst = max(ratios, key=lambda key: ratios[key])
    words = (
        f"{ratios['A', 'nominal']:.3f} on task A at {currents['A', 'nominal']:.2f} x its RMS "
        f"current; {ratios['B', 'nominal']:.3f} on task B; at worst {ratios[worst]:.3f} "
        f"(task {task}, {plant}) at up to {max(currents.values()):.2f} x the current"
    )
    claim = (
        f"tuned {name}: at most {most:g} of the mean end-effector error of the thesis's gains, "
        f"at most {MOST_CURRENT:g} x its current"
    )
    holds = max(ratios.values()) <= most and max(currents.values()) <= MOST_CURRENT
    return Claim("ours", claim, words, verdict(holds))


def _over(tuned: FamilyRow, before: FamilyRow) -> tuple[float, float]:
    """Ratios of mean error and of RMS current; infinite where one of the runs diverges."""
    numbers = (tuned.ee_mean, before.ee_mean, tuned.u_rms, before.u_rms)
    error, error_before, current, current_before = numbers
    if error is None or error_before is None or current is None or current_before is None:
        return float("inf"), float("inf")
    return error / error_before, current / current_before
