"""Tables that `jcontour learn` prints."""

from collections.abc import Sequence

from rich.console import Console

from jcontour.app.files.results.learned_result import LearnedMachine, LearnedResult
from jcontour.app.files.results.stored import Weight
from jcontour.app.reports.tables import digits, plain_table, say

SHOWN = (1, 2, 3, 4, 6, 8, 12, 20, 40, 80)  # laps that have a column


def show_learned(result: LearnedResult, console: Console) -> None:
    """What was known before, the errors lap by lap, when it stops paying."""
    say(console, *before(result), "")
    console.print(_table(result, "at the tool", [one.tool_um for one in result.machines]))
    if _differ(result):
        console.print(_table(result, "as measured", [one.measured_um for one in result.machines]))
    say(console, *after(result))


def before(result: LearnedResult) -> list[str]:
    """The law, and what is said before the first lap."""
    numbers = ", ".join(f"{name} {value:g}" for name, value in result.numbers.items())
    place = f"{result.ratio_member}, {result.ratio_hz:.4g} Hz"
    if result.assured:
        words = (
            "By its linear models, without dry friction, the laps converge on the whole family: "
            "away from the ends of the lap each comes closer by the factor "
            f"{result.ratio:.3g} at least, for every correction ({place})."
        )
    elif result.ratio < 1:
        words = (
            "By its linear models, without dry friction, each lap comes closer by the factor "
            f"{result.ratio:.3g} ({place}). This is an estimate at three places of the lap and no "
            "bound: the loop or the law changes along it."
        )
    else:
        words = (
            f"WARNING: it is not sure that the laps converge: ratio from lap to lap "
            f"{result.ratio:.3g}, not below one ({place})."
        )
    return [f"Law: {result.law}, {numbers}. {words}"]


def after(result: LearnedResult) -> list[str]:
    """Until when each machine gets better, and where it does not."""
    lines = [f"Encoder noise alone makes {digits(result.noise_um)} um, without learning."]
    for one in result.machines:
        lines.append(f"{one.name}: {_outcome(one)}")
    return lines


def loading(result: LearnedResult, file: str) -> list[str]:
    """What a control loads, what for, and what was not looked at."""
    one = result.stored
    if one is None:
        return ["Nothing to load: no lap of the linear model is better than the first"]
    if not result.verdict.usable:
        return [f"Not written: {file}, as lap {one.lap} of the linear model had it"]
    weights = ", ".join(f"{name} {_told(value)}" for name, value in result.weights.items())
    return [
        f"Load: {file}: the reference at every sample as lap {one.lap} of the linear model had it "
        f"({digits(one.error_um)} um), shifted by up to {digits(one.largest_um)} um; it begins "
        f"{digits(one.first_um)} um beside the part, a step for the tool that stands there, and "
        f"then asks an axis for up to {digits(one.speed)} m/s and {digits(one.acceleration)} m/s^2",
        f"      It is for {result.controller} with {weights}, and for no other one; on the machine "
        "go on from it lap by lap",
    ]


def _told(value: Weight) -> str:
    each = value if isinstance(value, list) else [value]
    return " ".join("none" if one is None else f"{one:.6g}" for one in each)


def _outcome(one: LearnedMachine) -> str:
    if one.diverged is not None:
        return f"diverges, stopped at lap {one.diverged}"
    first, best = one.tool_um[0], one.best_um
    if best is None:
        return "no lap has a finite error at the tool"
    if one.pays_until == 1:
        words = f"learning does not pay: {digits(first)} um in the first lap"
        if one.measured_um[-1] < 0.5 * one.measured_um[0]:
            words += "; the measured error falls, that of the tool is not measured"
        return words
    pays = (
        "in the last lap it still pays"
        if one.pays_until == len(one.tool_um)
        else (f"after lap {one.pays_until} it no longer pays")
    )
    return f"{digits(first)} to {digits(best)} um; {pays}"


def _differ(result: LearnedResult) -> bool:
    """Whether the tool has other errors than what is measured, encoder noise apart."""
    one = result.machines[0]
    return any(
        abs(a - b) > 1e-3 * max(a, b) for a, b in zip(one.tool_um, one.measured_um, strict=True)
    )


def _table(result: LearnedResult, where: str, rows: Sequence[Sequence[float]]):
    count = max(len(row) for row in rows)
    laps = sorted({lap for lap in SHOWN if lap <= count} | {count})
    cells = [
        [one.name, *(digits(row[lap - 1]) if lap <= len(row) else "-" for lap in laps)]
        for one, row in zip(result.machines, rows, strict=True)
    ]
    title = (
        f"{result.controller} on {result.contour}, {result.feed_law}: "
        f"RMS {result.error} error {where} by lap [um]"
    )
    return plain_table(title, ["machine", *(f"lap {lap}" for lap in laps)], cells)
