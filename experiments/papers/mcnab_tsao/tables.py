"""Tables that `jcontour reproduce mcnab-tsao` prints."""

from rich.console import Console
from rich.table import Table

from experiments.papers.mcnab_tsao.result import TERMINALS, Case, CaseRun, Result, Table1Row
from experiments.papers.verdicts import claims_table
from jcontour.app.reports.tables import worded_table

TABLE_1 = (
    "case",
    "weights",
    "te\npaper",
    "te\nours",
    "ratio",
    "ce\npaper",
    "ce\nours",
    "ratio",
    "verdict",
)
FAMILY = (
    "weights",
    "terminal",
    "ce\nnominal",
    "ce\nworst",
    "te\nworst",
    "largest\nradius",
    "verdict",
)
THEOREM_1 = ("alpha/beta/rho", "terminal", "horizon", "directions", "largest\nradius", "verdict")


def show(result: Result, console: Console) -> None:
    """Table 1, the verdicts, the family, the U-shape, and the unstable cases of Theorem 1."""
    tables = (
        _table_1(result),
        claims_table(result.claims, "Figures and statements"),
        _family(result),
        _u_shape(result),
        _theorem_1(result),
    )
    for table in tables:
        console.print(table)
        console.print()


def _table_1(result: Result) -> Table:
    title = (
        "Table 1: RMS errors over a lap of the circle [um], "
        "the machine (paper) beside the simulation (ours)"
    )
    return worded_table(title, TABLE_1, [_table_1_cells(row) for row in result.table_1])


def _table_1_cells(row: Table1Row) -> list[str]:
    weights = f"{row.terminal}\n{row.alpha:g}/{row.beta:g}"
    cells = [row.case.replace(" ", "\n"), weights]
    for pair in (row.te_um, row.ce_um):
        cells += [f"{pair.paper:.2f}", f"{pair.ours:.3f}", f"{pair.ratio:.2f}"]
    return [*cells, row.verdict.value]


def _family(result: Result) -> Table:
    """The weights the authors found on the machine, on a family of machines."""
    cases = dict.fromkeys(Case(row.terminal, row.alpha, row.beta) for row in result.table_1)
    rows = []
    for case in cases:
        name = f"Table 1: {case.alpha:g}/{case.beta:g}"
        rows.append(_on_family(result, name, result.run_of(case)))
    for terminal in TERMINALS:
        best = _best_stable(result, terminal)
        if best is not None:
            name = f"best stable of the grid: {best.alpha:g}/{best.beta:g}"
            rows.append(_on_family(result, name, best))
    title = "Table 1's weights on the family of machines: unknown input gains and delays [um]"
    return worded_table(title, FAMILY, rows)


def _best_stable(result: Result, terminal: str) -> CaseRun | None:
    """Run of the grid with the least worst contour error among those stable on every machine."""
    pairs = [(alpha, beta) for alpha in result.weights.alpha for beta in result.weights.beta]
    runs = [result.run_of(Case(terminal, *pair)) for pair in pairs]
    stable = [run for run in runs if _radius(run) < 1]
    return min(stable, key=lambda run: _worst(run, "ce_um"), default=None)


def _on_family(result: Result, name: str, run: CaseRun) -> list[str]:
    pairs = zip(result.family, run.machines, strict=True)
    unstable = [str(member.delay) for member, found in pairs if not found.stable]
    verdict = "stable on every machine"
    if unstable:
        verdict = f"frozen loops unstable at delay {', '.join(unstable)}"
    errors = (run.machines[0].ce_um, _worst(run, "ce_um"), _worst(run, "te_um"))
    return [name, run.terminal, *map(_number, errors), f"{_radius(run):.4f}", verdict]


def _radius(run: CaseRun) -> float:
    return max(machine.spectral_radius for machine in run.machines)


def _worst(run: CaseRun, error: str) -> float:
    """Largest error on the family; infinite where a run diverges."""
    if any(machine.diverged for machine in run.machines):
        return float("inf")
    return max(getattr(machine, error) for machine in run.machines)


def _u_shape(result: Result) -> Table:
    delay = result.family[-1].delay
    rows = []
    for alpha in result.weights.all_alphas:
        machines = result.run_of(Case("output", alpha, 0.0)).machines
        ideal, late = machines[0], machines[-1]
        errors = (ideal.te_um, ideal.ce_um, late.te_um, late.ce_um)
        verdict = "stable" if late.stable else "unstable: the numbers mean nothing"
        radius = f"{late.spectral_radius:.4f}"
        rows.append([f"{alpha:g}", *map(_number, errors), radius, verdict])
    nominal, delayed = ("te\nnominal", "ce\nnominal"), (f"te\ndelay {delay}", f"ce\ndelay {delay}")
    title = (
        "Figs 3 and 5: beta 0, output terminal, "
        f"unknown input delay [samples]: {delay}; errors [um]"
    )
    return worded_table(title, ("alpha", *nominal, *delayed, "frozen\nradius", "verdict"), rows)


def _theorem_1(result: Result) -> Table:
    theorem, rows = result.theorem_1, []
    for loop in theorem.unstable:
        weights = f"{loop.alpha:g}/{loop.beta:g}/{loop.rho:.0e}"
        directions = f"{loop.unstable_directions} of {theorem.directions}"
        radius = f"{loop.largest_radius:.4f}"
        rows.append([weights, loop.terminal, str(loop.preview), directions, radius, "unstable"])
    title = "Theorem 1: every unstable case on straight lines" + ("" if rows else ": none")
    return worded_table(title, THEOREM_1, rows)


def _number(value: float | None) -> str:
    return "diverged" if value is None or not abs(value) < 1e6 else f"{value:.4g}"
