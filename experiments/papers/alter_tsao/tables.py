"""Tables that `jcontour reproduce alter-tsao` prints."""

from rich.console import Console
from rich.table import Table

from experiments.papers.alter_tsao.result import Line, Result
from experiments.papers.alter_tsao.runs import NEAR
from experiments.papers.verdicts import Verdict, claims_table
from jcontour.app.reports.tables import plain_table

LINES = ("line", "m", "Np", "N", "l1 cost", "H-inf. cost", "print", "ours", "", "drive")
COSTS = ("m", "Np", "N", "J_1\nprint", "J_1\nours", "limit\nprint", "limit\nours", "attained")
LOOPS = ("loop", "m", "Np", "N", "max error m", "from filter m", "slowest pole")
MARKS = {Verdict.REPRODUCED: "=", Verdict.IN_PART: "~"}


def show(result: Result, console: Console) -> None:
    """Tables 1 and 2, the loops, the costs over eps, and the verdicts."""
    both = (_table_1(result, "max"), _table_1(result, "rms"))
    for table in (*both, _table_2(result), _loops(result), _perturbed(result)):
        if table.row_count:
            console.print(table)
    console.print(claims_table(result.claims))


def _table_1(result: Result, name: str) -> Table:
    words = {"max": "largest error", "rms": "RMS error"}[name]
    title = (
        f"Table 1, {words} in m: simulated in print and here, and measured on the drive\n"
        f"= rounds to the print, ~ within {1e9 * NEAR:g} nm, by a digit less or with the printed "
        "zero, x neither\n"
        "m: order of the reference model, Np: preview [samples], N: difference of the reference "
        "that is bounded"
    )
    rows = [_cells(line, name) for line in result.table_1]
    return plain_table(title, LINES, rows, text_columns=0)


def _cells(line: Line, name: str) -> list[str]:
    numbers = [str(n) for n in (line.line, line.order, line.preview, line.constraint)]
    costs = [f"{line.l1_cost:.4g}", f"{line.hinf_cost:.4g}"]
    mark = MARKS.get(getattr(line, f"{name}_verdict"), "x")
    printed, measured = getattr(line, f"printed_{name}"), getattr(line, f"measured_{name}")
    return [*numbers, *costs, printed, _short(getattr(line, f"{name}_error")), mark, measured]


def _short(error: float) -> str:
    """As the paper prints it: 1.2345e-6."""
    mantissa, _, exponent = f"{error:.4e}".partition("e")
    return f"{mantissa}e{int(exponent)}"


def _table_2(result: Result) -> Table:
    rows = []
    for row in result.table_2:
        numbers = [str(n) for n in (row.order, row.preview, row.constraint)]
        ours = (f"{row.optimal:.5g}", row.printed_limit, f"{row.limit:.5g}")
        rows.append([*numbers, row.printed_optimal, *ours, f"{row.attainable:.5g}"])
    return plain_table("Table 2: costs with integral action", COSTS, rows, text_columns=0)


def _loops(result: Result) -> Table:
    rows = []
    for run in result.loops:
        numbers = [str(n) for n in (run.order, run.preview, run.constraint)]
        errors = (f"{run.max_error:.4g}", f"{run.apart:.1e}", f"{run.slowest_pole:.4f}")
        rows.append([run.controller, *numbers, *errors])
    title = "Loops with an example drive that has the paper's zero; it is not the authors' motor"
    return plain_table(title, LOOPS, rows)


def _perturbed(result: Result) -> Table:
    rows = [[f"{row.eps:g}", f"{row.l1:.5g}", f"{row.hinf:.5g}"] for row in result.perturbed]
    title = "Costs of (0, 9, 0) with integral action, the zero moved to 1 + eps; our feedback"
    return plain_table(title, ("eps", "l1", "H-infinity"), rows, text_columns=0)
