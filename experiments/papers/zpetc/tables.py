"""Tables that `jcontour reproduce zpetc` prints."""

from rich.console import Console
from rich.table import Table

from experiments.papers.verdicts import claims_table
from experiments.papers.zpetc.claims import agrees
from experiments.papers.zpetc.published import BEST_TIME, TABLE_2
from experiments.papers.zpetc.result import Result
from jcontour.app.reports.tables import plain_table

MODELS = ("model", "servo pole\nrad/s", "gain", "print", "zero", "print", "poles", "print", "")
ADAPTIVE = (
    *("servo", "start\na_1, b_0", "rule", "tr F(0)", "mean\num", "peak\num", "second\nhalf um"),
    *("end\na_1", "end\nb_0", "end\ntr F"),
)


def show(result: Result, console: Console) -> None:
    """Models, the sweep of the integral time, adaptive runs, and the verdicts."""
    for table in (_models(result), _integral(result), _printed_times(), _adaptive(result)):
        console.print(table)
    console.print(claims_table(result.claims))


def _models(result: Result) -> Table:
    rows = []
    for one in result.models:
        ours = ", ".join(f"{pole:.5g}" for pole in one.poles)
        numbers = [f"{one.gain:.5g}", one.printed_gain, f"{one.zero:.5g}", one.printed_zero]
        poles = [ours, ", ".join(one.printed_poles), "=" if agrees(one) else "x"]
        rows.append([one.item, f"{one.pole_rad_s:.6g}", *numbers, *poles])
    return plain_table("Models: = all digits as printed", MODELS, rows)


def _integral(result: Result) -> Table:
    truths = list(dict.fromkeys(row.truth for row in result.integral))
    times = list(dict.fromkeys(row.integral_time for row in result.integral))
    means = {(row.truth, row.integral_time): row.mean_um for row in result.integral}
    rows = []
    for time in times:
        name = "none" if time is None else f"{time:g}"
        rows.append([name, *(f"{means[truth, time]:.1f}" for truth in truths)])
    title = "Mean error in um over the integral time in s; servos that the model misses"
    return plain_table(title, ("T_i", *truths), rows)


def _printed_times() -> Table:
    rows = [[f"{row.good:g}", f"{row.poor:g}"] for row in TABLE_2]
    known = f"T_i is lost but for the best, {BEST_TIME:g} s"
    title = f"Table 2, measured mean error in um; {known}"
    return plain_table(title, ("good model", "poor model"), rows, text_columns=0)


def _adaptive(result: Result) -> Table:
    rows = []
    for row in result.adaptive:
        start = f"{row.theta[0]:g}, {row.theta[1]:g}"
        errors = [f"{x:.1f}" for x in (row.mean_um, row.peak_um, row.second_half_um)]
        end = [f"{x:.4f}" for x in row.final_theta]
        trace = f"{row.final_trace:.4g}"
        rows.append([row.truth, start, row.rule, f"{row.trace:g}", *errors, *end, trace])
    title = "Adaptive runs at 16.8 ms: forgetting factor corrected, as printed, no adaptation"
    return plain_table(title, ADAPTIVE, rows, text_columns=3)
