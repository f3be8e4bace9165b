"""Tables that `jcontour reproduce yuan-gantry` prints."""

from rich.console import Console
from rich.table import Table

from experiments.benchmarks.speed.gantry_engines import show_engines
from experiments.papers.verdicts import claims_table
from experiments.papers.yuan_gantry.result import EmulatedRun, Result
from jcontour.app.reports.tables import digits, plain_table

EMULATED = (
    "head",
    "X\num",
    "Y\num",
    "contour\num",
    "from the\ngantry um",
    "twist\nurad",
    "load\nA",
    "F_Nx\nmm/s",
)


def show(result: Result, console: Console) -> None:
    """Frequencies, identified quantities, the emulated head, engines, statements."""
    console.print(_responses(result))
    console.print(_identified(result))
    console.print(_emulated(result))
    show_engines(result.engines, console)
    console.print(claims_table(result.claims))


def _responses(result: Result) -> Table:
    rows = []
    for row in result.responses:
        coupling = "kept" if row.coupling else "as printed"
        frequencies = (row.antiresonance_hz, row.resonance_hz)
        rows.append([f"{row.head_m:g}", coupling, *(f"{value:.2f}" for value in frequencies)])
    columns = ("head m", "coupling M_e x_h", "anti-resonance Hz", "resonance Hz")
    title = "Fig. 5.6: from the current of a drive to its speed"
    return plain_table(title, columns, rows, text_columns=2)


def _identified(result: Result) -> Table:
    rows = []
    for row in result.identified:
        numbers = (row.true, row.found, *row.interval)
        rows.append([row.name, *(f"{value:.6g}" for value in numbers)])
    columns = ("", "true", "found", "95 % from", "to")
    return plain_table("Section 5.2.2: identified from chirps at two head positions", columns, rows)


def _emulated(result: Result) -> Table:
    title = (
        "Section 5.6: a motor bench for the head, at once or one sample late, along Fig. 5.11; "
        "largest errors of the tool"
    )
    return plain_table(title, EMULATED, [_cells(row) for row in result.emulated.rows])


def _cells(row: EmulatedRun) -> list[str]:
    if row.diverged:
        return [row.name, "diverged", *["-"] * 6]
    errors = (
        row.peak_x_error_m,
        row.peak_y_error_m,
        row.peak_contour_error_m,
        row.distance_m,
        row.peak_twist_rad,
    )
    remainder = row.peak_remainder_m_per_s
    remainder_mm = None if remainder is None else 1e3 * remainder
    cells = [digits(1e6 * error) for error in errors]
    return [row.name, *cells, digits(row.peak_load_a), digits(remainder_mm)]
