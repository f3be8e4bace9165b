"""What `jcontour reproduce mcnab-tsao` prints."""

from typing import Any

from rich.console import Console
from rich.table import Table

from experiments.papers.mcnab_tsao.claims import run_of
from experiments.reports.tables import worded_table


def show(summary: dict[str, Any], console: Console) -> None:
    """Table 1, the verdicts on figures and statements, the U-shape, and the unstable cases of Theorem 1."""
    for table in (
        _table_1(summary),
        _claims(summary),
        _family(summary),
        _u_shape(summary),
        _theorem_1(summary),
    ):
        console.print(table)
        console.print()


def _table_1(summary: dict[str, Any]) -> Table:
    rows = []
    for row in summary["table_1"]:
        pairs = [row[error] for error in ("te_um", "ce_um")]
        errors = [
            cell
            for pair in pairs
            for cell in (f"{pair['paper']:.2f}", f"{pair['ours']:.3f}", f"{pair['ratio']:.2f}")
        ]
        rows.append(
            (
                row["case"].replace(" ", "\n"),
                f"{row['terminal']}\n{row['alpha']:g}/{row['beta']:g}",
                *errors,
                row["verdict"],
            )
        )
    headings = (
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
    return worded_table(
        "Table 1: RMS errors over a lap of the circle [um], the machine (paper) beside the simulation (ours)",
        headings,
        rows,
    )


def _claims(summary: dict[str, Any]) -> Table:
    rows = [
        (row["item"], row["claim"], row["finding"], row["verdict"]) for row in summary["claims"]
    ]
    return worded_table(
        "Figures and statements", ("where", "the paper", "the simulation", "verdict"), rows
    )


def _family(summary: dict[str, Any]) -> Table:
    """The weights the authors found on the machine, on a family of machines."""
    seen = dict.fromkeys((row["terminal"], row["alpha"], row["beta"]) for row in summary["table_1"])
    rows = [
        _on_family(summary, f"Table 1: {alpha:g}/{beta:g}", run_of(summary, t, alpha, beta))
        for t, alpha, beta in seen
    ]
    for terminal in ("output", "dare"):
        alphas, betas = summary["weights"]["alpha"], summary["weights"]["beta"]
        grid = [run_of(summary, terminal, alpha, beta) for alpha in alphas for beta in betas]
        stable = [run for run in grid if _radius(run) < 1]
        if stable:
            best = min(stable, key=lambda run: _worst(run, "ce_um"))
            rows.append(
                _on_family(
                    summary, f"best stable of the grid: {best['alpha']:g}/{best['beta']:g}", best
                )
            )
    headings = (
        "weights",
        "terminal",
        "ce\nnominal",
        "ce\nworst",
        "te\nworst",
        "largest\nradius",
        "verdict",
    )
    return worded_table(
        "Table 1's weights on the family of machines: unknown input gains and delays [um]",
        headings,
        rows,
    )


def _on_family(summary: dict[str, Any], name: str, run: dict[str, Any]) -> tuple[str, ...]:
    unstable = [
        str(m["delay"])
        for m, found in zip(summary["family"], run["machines"], strict=True)
        if found["spectral_radius"] >= 1
    ]
    verdict = (
        f"frozen loops unstable at delay {', '.join(unstable)}"
        if unstable
        else "stable on every machine"
    )
    worst = [_number(_worst(run, error)) for error in ("ce_um", "te_um")]
    return (
        name,
        run["terminal"],
        _number(run["machines"][0]["ce_um"]),
        *worst,
        f"{_radius(run):.4f}",
        verdict,
    )


def _radius(run: dict[str, Any]) -> float:
    return max(machine["spectral_radius"] for machine in run["machines"])


def _worst(run: dict[str, Any], error: str) -> float:
    return max(
        float("inf") if machine["diverged"] else machine[error] for machine in run["machines"]
    )


def _u_shape(summary: dict[str, Any]) -> Table:
    delay, rows = summary["family"][-1]["delay"], []
    for alpha in (*summary["weights"]["alpha"], summary["weights"]["too_high_alpha"]):
        machines = run_of(summary, "output", alpha, 0.0)["machines"]
        ideal, late = machines[0], machines[-1]
        numbers = [_number(m[error]) for m in (ideal, late) for error in ("te_um", "ce_um")]
        verdict = "stable" if late["spectral_radius"] < 1 else "unstable: the numbers mean nothing"
        rows.append((f"{alpha:g}", *numbers, f"{late['spectral_radius']:.4f}", verdict))
    headings = (
        "alpha",
        "te\nnominal",
        "ce\nnominal",
        f"te\ndelay {delay}",
        f"ce\ndelay {delay}",
        "frozen\nradius",
        "verdict",
    )
    return worded_table(
        f"Figs 3 and 5: beta 0, output terminal, unknown input delay [samples]: {delay}; errors [um]",
        headings,
        rows,
    )


def _theorem_1(summary: dict[str, Any]) -> Table:
    theorem, rows = summary["theorem_1"], []
    for case in theorem["unstable"]:
        directions = f"{case['unstable_directions']} of {theorem['directions']}"
        weights = f"{case['alpha']:g}/{case['beta']:g}/{case['rho']:.0e}"
        rows.append(
            (
                weights,
                case["terminal"],
                str(case["preview"]),
                directions,
                f"{case['largest_radius']:.4f}",
                "unstable",
            )
        )
    headings = ("alpha/beta/rho", "terminal", "horizon", "directions", "largest\nradius", "verdict")
    return worded_table(
        "Theorem 1: every unstable case on straight lines" + ("" if rows else ": none"),
        headings,
        rows,
    )


def _number(value: float | None) -> str:
    return "diverged" if value is None or not abs(value) < 1e6 else f"{value:.4g}"
