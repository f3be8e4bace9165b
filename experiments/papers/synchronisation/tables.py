"""Tables that `jcontour reproduce synchronisation` prints."""

from rich.console import Console
from rich.table import Table

from experiments.papers.synchronisation.claims import ZERO
from experiments.papers.synchronisation.result import CONTINUOUS, Bounds, Result, Row
from experiments.papers.synchronisation.runs import PLANTS
from experiments.papers.verdicts import claims_table
from jcontour.app.reports.tables import digits, plain_table, say

HEADINGS = ("axes", "time", "beta", "peak\napart", "integral\napart s", "peak\ne1", "peak\ne2")
LIMITS = ("axes", "time", "K", "(9)", "(17)", "exact loop")


def show(result: Result, console: Console) -> None:
    """What is ours, the responses, the bounds on beta, the statements."""
    say(console, "The paper prints no plant and no gains. Ours, per unit of speed and of control:")
    say(console, *map(_words, PLANTS), "")
    title = "Step of load on axis 2"
    console.print(plain_table(title, HEADINGS, [_cells(row) for row in result.rows], 2))
    console.print(_limits(result))
    console.print(claims_table(result.claims))


def _words(name: str) -> str:
    plant = PLANTS[name]
    poles, gains = (", ".join(f"{x:g}" for x in values) for values in plant.axes)
    feedback = ", ".join(f"{x:g}" for x in plant.proportional)
    return (
        f"  {name}: a = {poles} 1/s, b = {gains}, k_c = {feedback}, "
        f"gamma = {plant.adaptation:g} 1/s (sampled: gamma T), v_c = 1"
    )


def _cells(row: Row) -> list[str]:
    numbers = (row.peak_sync, row.iae_sync, row.peak_e1, row.peak_e2)
    words = ["diverged"] * 4 if row.diverged else [_number(value) for value in numbers]
    return [row.plant, _time(row.period_ms), f"{row.beta:g}", *words]


def _number(value: float) -> str:
    return "0" if value < ZERO else digits(value)


def _limits(result: Result) -> Table:
    rows = [_limit_cells(row) for row in result.bounds]
    return plain_table("Bounds on beta", LIMITS, rows, 2)


def _limit_cells(row: Bounds) -> list[str]:
    numbers = (row.continuous, row.proven, row.exact)
    words = ["none" if value is None else digits(value) for value in numbers]
    return [row.plant, _time(row.period_ms), digits(row.adaptation), *words]


def _time(period_ms: float) -> str:
    return "continuous" if period_ms == CONTINUOUS else f"{period_ms:g} ms"
