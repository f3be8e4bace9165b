"""What Yuan says about tracking in chapter 3, what we ask of the tuner, what the simulation says, and the verdicts."""

from collections.abc import Sequence
from typing import Any

from experiments.papers.verdicts import Verdict

Claim = dict[str, str]  # item, claim, finding, verdict
OURS = {  # row of the thesis's tables -> ours; how its observer is sampled the thesis does not say
    "Cascaded PI": ("cascade",),
    "Cascaded PI with filter": ("cascade-notch",),
    "Cascaded PI with LESO": ("cascade-leso-exact", "cascade-leso-euler", "cascade-leso"),
}
COLUMNS = ("em_max", "em_mean", "ee_max", "ee_mean", "def_max", "u_mean")
MARGINAL = 0.1  # a change up to which an improvement is marginal
LARGEST_GAP = 0.03  # between the smooth twin at its default sharpness and the true axis
DEFAULT_SHARPNESS = 1e3
TARGETS = {
    "cascade": 0.6,
    "cascade-feedforward": 0.15,
}  # mean end-effector error on task A over that of the thesis's gains
MOST_CURRENT = 1.2  # over that of the thesis's gains


def row_of(rows: Sequence[dict[str, Any]], controller: str, gains: str = "start") -> dict[str, Any]:
    """The one row of a controller.

    Raises:
        KeyError: it has not been run.
    """
    for row in rows:
        if (row["controller"], row["gains"]) == (controller, gains):
            return row
    raise KeyError(f"{controller}, {gains}")


def table_rows(published: Sequence[Any], rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Tables 3.1 and 3.2: each measured row, ours below it. All of them are measurements: shown, not matched."""
    found = []
    for measured in published:
        ours = [(name, row_of(rows, name)) for name in OURS[measured.name]]
        found.append(
            {
                "task": measured.task,
                "name": measured.name,
                "verdict": Verdict.EXPERIMENTAL.value,
                "paper": {column: getattr(measured, column) for column in COLUMNS},
                "paper_time_ms": measured.time_ms,
                "ours": {
                    name: {**{c: row[measured.task][c] for c in COLUMNS}, "time_us": row["time_us"]}
                    for name, row in ours
                },
            }
        )
    return found


def claims(summary: dict[str, Any], confirmed: Sequence[str]) -> list[Claim]:
    """Statements of section 3.4.3, then the project's own targets for the twin and for the controllers that were tuned."""
    rows = summary["ranking"]
    found = [
        _tool_vibrates_more(rows),
        _filter_is_marginal(rows),
        _filter_relieves_the_link(rows),
        _observer_on_task_a(rows),
        _observer_on_task_b(rows),
        _twin(summary["gap"]),
    ]
    tuned = {row["controller"] for row in rows if row["gains"] == "tuned"}
    return found + [_target(rows, name) for name in confirmed if name in tuned]


def _claim(item: str, claim: str, finding: str, verdict: Verdict) -> Claim:
    return {"item": item, "claim": claim, "finding": finding, "verdict": verdict.value}


def _verdict(holds: bool) -> Verdict:
    return Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED


def _tool_vibrates_more(rows) -> Claim:
    pairs = [
        (task, name, row_of(rows, name)[task])
        for task in "AB"
        for names in OURS.values()
        for name in names
    ]
    lost = [f"{name} on {task}" for task, name, m in pairs if m["ee_max"] <= m["em_max"]]
    worst = max(m["ee_max"] / m["em_max"] for _, _, m in pairs)
    words = f"largest error of the end effector up to {worst:.2f} x the motor's" + (
        f"; not for {', '.join(lost)}" if lost else ""
    )
    return _claim(
        "section 3.4.3", "the end effector vibrates more than the motor", words, _verdict(not lost)
    )


def _changes(rows, name: str, task: str) -> dict[str, float]:
    ours, plain = row_of(rows, name)[task], row_of(rows, "cascade")[task]
    return {column: ours[column] / plain[column] - 1 for column in COLUMNS}


def _filter_is_marginal(rows) -> Claim:
    changes = [change for task in "AB" for change in _changes(rows, "cascade-notch", task).values()]
    words = f"its metrics change by {100 * min(changes):+.2f} to {100 * max(changes):+.2f} %"
    return _claim(
        "section 3.4.3",
        "the notch changes most metrics marginally",
        words,
        _verdict(max(map(abs, changes)) < MARGINAL),
    )


def _filter_relieves_the_link(rows) -> Claim:
    found = {task: _changes(rows, "cascade-notch", task)["def_max"] for task in "AB"}
    words = ", ".join(f"{100 * change:+.2f} % on task {task}" for task, change in found.items())
    holds = all(change < -MARGINAL for change in found.values())
    return _claim(
        "section 3.4.3",
        "the notch lowers the largest deformation by 11 % on task A, 33 % on task B",
        words,
        _verdict(holds),
    )


def _observer_on_task_a(rows) -> Claim:
    found = {name: _changes(rows, name, "A") for name in OURS["Cascaded PI with LESO"]}
    words = "; ".join(
        f"{name}: {100 * c['em_max']:+.1f} % largest, {100 * c['em_mean']:+.1f} % mean"
        for name, c in found.items()
    )
    holds = all(c["em_max"] < 0 and c["em_mean"] < 0 for c in found.values())
    return _claim(
        "section 3.4.3",
        "the LESO improves the motor's largest and mean error on task A",
        words,
        _verdict(holds),
    )


def _observer_on_task_b(rows) -> Claim:
    found = {name: _changes(rows, name, "B") for name in OURS["Cascaded PI with LESO"]}
    words = "; ".join(
        f"{name}: motor {100 * c['em_mean']:+.1f} %, tool {100 * c['ee_mean']:+.1f} % (mean)"
        for name, c in found.items()
    )
    return _claim(
        "section 3.4.3",
        "the LESO worsens motor and end effector on task B",
        words,
        Verdict.EXPERIMENTAL,
    )


def _twin(gap: Sequence[dict[str, float]]) -> Claim:
    default = next(row for row in gap if row["sharpness"] == DEFAULT_SHARPNESS)
    shrinks = all(gap[-1][task] < gap[0][task] for task in "AB")
    words = f"{100 * default['A']:.3f} % on task A, {100 * default['B']:.3f} % on task B; " + (
        "smaller the sharper" if shrinks else "not smaller the sharper"
    )
    holds = shrinks and max(default["A"], default["B"]) <= LARGEST_GAP
    return _claim(
        "ours",
        "the smooth twin is within 3 % of the true axis in RMS end-effector error",
        words,
        _verdict(holds),
    )


def _target(rows, name: str) -> Claim:
    """On task A nominally; on task B and off by 20 % against the thesis's gains on the same plant."""
    most, tuned = TARGETS[name], row_of(rows, name, "tuned")
    before = {(m["task"], m["plant"]): m for m in row_of(rows, "cascade")["family"]}
    ratios, currents = {}, {}
    for member in tuned["family"]:
        key = (member["task"], member["plant"])
        lost = member["diverged"] or before[key]["diverged"]
        ratios[key] = float("inf") if lost else member["ee_mean"] / before[key]["ee_mean"]
        currents[key] = float("inf") if lost else member["u_rms"] / before[key]["u_rms"]
    nominal, worst = ratios["A", "nominal"], max(ratios, key=lambda key: ratios[key])
    words = (
        f"{nominal:.3f} on task A at {currents['A', 'nominal']:.2f} x its RMS current; {ratios['B', 'nominal']:.3f} on task B; "
        f"at worst {ratios[worst]:.3f} (task {worst[0]}, {worst[1]}) at up to {max(currents.values()):.2f} x the current"
    )
    holds = max(ratios.values()) <= most and max(currents.values()) <= MOST_CURRENT
    claim = f"tuned {name}: at most {most:g} of the mean end-effector error of the thesis's gains, at most {MOST_CURRENT:g} x its current"
    return _claim("ours", claim, words, _verdict(holds))
