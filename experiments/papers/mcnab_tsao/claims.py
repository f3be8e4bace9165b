"""Statements of McNab & Tsao, what the simulation says, and the verdicts."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from experiments.papers.mcnab_tsao.result import (
    TERMINALS,
    Case,
    CaseRun,
    Compared,
    MachineRun,
    Result,
    Table1Row,
)
from experiments.papers.verdicts import Claim, Verdict

STEADY = 0.25  # relative spread that still counts as constant in Figs 9 and 10
KNEE = 9  # [samples] the preview after which the paper sees no gain (its section 4)
LITTLE = 1 / 3  # relative change that still counts as little effect
EQUAL = 1e-9  # relative
FIGURE_2_ALPHA = 1.2  # the largest at which the points of Fig. 2 can still be told apart
FIGURE_9, FIGURE_10 = (4.0, 0.0), (0.25, 15.0)  # the paper's alpha, beta
CIRCLE_MM = 1.0  # radius

Table = dict[tuple[float, float], float]  # (alpha, beta) -> error [um]


class PublishedRow(NamedTuple):
    """Row of the paper's Table 1: RMS errors over one lap of the circle, on the machine."""

    case: str
    terminal: str
    alpha: float
    beta: float
    te_um: float
    ce_um: float


def table_1(published: Iterable[PublishedRow], result: Result) -> tuple[Table1Row, ...]:
    """The paper's rows with ours beside them: measurements, shown and not matched."""
    rows = []
    for row in published:
        run = result.nominal(Case(row.terminal, row.alpha, row.beta))
        if row.case == "finite preview":
            run = result.finite_preview.nominal[row.case]
        tracking = _compared(row.te_um, run.te_um)
        contour = _compared(row.ce_um, run.ce_um)
        case = (row.case, row.terminal, row.alpha, row.beta)
        rows.append(Table1Row(*case, tracking, contour, Verdict.EXPERIMENTAL))
    return tuple(rows)


def table_over_weights(result: Result, terminal: str, error: str) -> Table:
    """One error on the nominal machine over the weight grid, by (alpha, beta)."""
    pairs = [(alpha, beta) for alpha in result.weights.alpha for beta in result.weights.beta]
    return {pair: getattr(result.nominal(Case(terminal, *pair)), error) for pair in pairs}


def over_previews(
    result: Result, terminal: str, weights: tuple[float, float], error: str
) -> tuple[list[int], list[float]]:
    """Preview lengths, and one error on the nominal machine."""
    wanted = (terminal, *weights)
    runs = [run for run in result.runs if (run.terminal, run.alpha, run.beta) == wanted]
    runs.sort(key=lambda run: run.preview)
    return [run.preview for run in runs], [getattr(run.machines[0], error) for run in runs]


def claims(result: Result) -> tuple[Claim, ...]:
    """All that the paper shows or states beside the numbers of Table 1, one row each."""
    parts = (
        _figure_2,
        _measured_figures,
        _figure_4,
        _figure_6,
        _tracking_weight,
        _little_effect,
        _terminals,
        _figure_9,
        _figure_10,
        _theorem_1,
        _trade,
        _finite_preview,
        _line,
    )
    return tuple(row for part in parts for row in part(result))


def _compared(paper: float, ours: float | None) -> Compared:
    assert ours is not None  # the nominal machine does not diverge
    return Compared(paper, ours, ours / paper)


def _figure_2(result: Result) -> Iterator[Claim]:
    betas = result.weights.beta
    errors = [result.nominal(Case("output", FIGURE_2_ALPHA, beta)).ce_um for beta in betas]
    finding = (
        f"RMS contour error {listed(errors)} um at beta {listed(betas)} "
        f"(alpha {FIGURE_2_ALPHA:g}, output terminal)"
    )
    claim = "contour weight moves the points onto the circle"
    yield Claim("Fig. 2", claim, finding, _if(_falls(errors), Verdict.REPRODUCED))


def _measured_figures(result: Result) -> Iterator[Claim]:
    numbers = {
        "Fig. 3": ("output", "te_um"),
        "Fig. 5": ("output", "ce_um"),
        "Fig. 7": ("dare", "te_um"),
        "Fig. 8": ("dare", "ce_um"),
    }
    for figure, (terminal, error) in numbers.items():
        yield _measured_figure(result, figure, terminal, error)


def _measured_figure(result: Result, figure: str, terminal: str, error: str) -> Claim:
    """U-shape over alpha on the machine that is latest."""
    alphas, delay = result.weights.all_alphas, result.family[-1].delay
    runs = {alpha: result.run_of(Case(terminal, alpha, 0.0)).machines for alpha in alphas}
    late = {alpha: machines[-1] for alpha, machines in runs.items()}
    stable = {alpha: getattr(run, error) for alpha, run in late.items() if run.stable}
    lost = [
        f"{a:g} (radius {run.spectral_radius:.4f})" for a, run in late.items() if not run.stable
    ]
    best = min(stable, key=lambda alpha: stable[alpha], default=alphas[0])
    least = stable.get(best, float("nan"))
    finding = f"delay {delay}, beta 0: least {least:.3g} um at alpha {best:g}, "
    if lost:
        finding += f"unstable at alpha {' and '.join(lost)}"
    else:
        finding += f"{stable[alphas[-1]]:.3g} um at {alphas[-1]:g}"
    if _falls([getattr(machines[0], error) for machines in runs.values()]):
        finding += "; the nominal machine only improves"
    holds = alphas[0] < best < alphas[-1]
    claim = "measured errors fall with the weight, then rise"
    return Claim(figure, claim, finding, _if(holds, Verdict.SAME_ORDERING))


def _figure_4(result: Result) -> Iterator[Claim]:
    table, (alphas, betas) = table_over_weights(result, "output", "te_um"), _axes(result)
    columns = {beta: [table[alpha, beta] for alpha in alphas] for beta in betas}
    holds = all(_falls(column) for column in columns.values())
    first, last = table[alphas[0], betas[0]], table[alphas[-1], betas[0]]
    words = "falls" if holds else "does not always fall"
    finding = f"{words} with alpha, {first:.4g} to {last:.4g} um at beta {betas[0]:g}"
    claim = "simulated tracking error falls as weights grow (no numbers given)"
    yield Claim("Fig. 4", claim, finding, _if(holds, Verdict.SAME_ORDERING))


def _figure_6(result: Result) -> Iterator[Claim]:
    claim = "simulated contour error falls as contour weight grows (no numbers given)"
    alphas, betas = _axes(result)
    for terminal, item in (("output", "Fig. 6"), ("dare", "as Fig. 6, H_s")):
        true = table_over_weights(result, terminal, "ce_um")
        rows = {alpha: [true[alpha, beta] for beta in betas] for alpha in alphas}
        holds = [alpha for alpha in alphas if _falls(rows[alpha])]
        if holds:
            last = holds[-1]
            finding = f"at alpha {listed(holds)}; at {last:g}: {listed(rows[last])} um over beta"
            yield Claim(item, claim, finding, Verdict.SAME_ORDERING)
        for alpha in alphas:
            if alpha not in holds:
                finding = f"alpha {alpha:g}: {listed(rows[alpha])} um"
                finding += _lag_leaves_the_circle(result, terminal, alpha)
                yield Claim(item, claim, finding, Verdict.NOT_REPRODUCED)


def _lag_leaves_the_circle(result: Result, terminal: str, alpha: float) -> str:
    """Remark where eq. 3's error does fall: a lag along the tangent leaves the circle."""
    runs = [result.nominal(Case(terminal, alpha, beta)) for beta in result.weights.beta]
    lag = runs[-1].te_um
    if lag is None or not _falls([run.projected_um for run in runs]):
        return ""
    off = lag**2 / (2e3 * CIRCLE_MM)  # [um]
    return (
        f"; eq. 3's error does fall, but a lag of {lag:.3g} um lies {off:.2g} um off a 1 mm circle"
    )


def _tracking_weight(result: Result) -> Iterator[Claim]:
    claim = "tracking weight lowers the contour error too"
    alphas, betas = _axes(result)
    for terminal in TERMINALS:
        table, item = table_over_weights(result, terminal, "ce_um"), f"sec. 4, {terminal}"
        columns = {beta: [table[alpha, beta] for alpha in alphas] for beta in betas}
        holds = [beta for beta in betas if _falls(columns[beta])]
        others = [beta for beta in betas if beta not in holds]
        if holds:
            yield Claim(item, claim, f"at beta {listed(holds)}", Verdict.SAME_ORDERING)
        if others:
            errors = columns[others[-1]]
            finding = (
                f"at beta {listed(others)}: the contour weight rules it, "
                f"{listed(errors)} um over alpha at {others[-1]:g}"
            )
            yield Claim(item, claim, finding, Verdict.NOT_REPRODUCED)


def _little_effect(result: Result) -> Iterator[Claim]:
    claim = "contour weight hardly changes the tracking error"
    alphas, betas = _axes(result)
    for terminal in TERMINALS:
        table = table_over_weights(result, terminal, "te_um")
        change = {}
        for alpha in alphas:
            plain = table[alpha, betas[0]]
            change[alpha] = max(abs(table[alpha, beta] / plain - 1) for beta in betas)
        worst = max(change, key=lambda alpha: change[alpha])
        little = change[worst] <= LITTLE
        finding = f"changes by at most {100 * change[worst]:.0f} % over beta (at alpha {worst:g})"
        if terminal == "dare" and not little:
            finding += "; H_s(Q_max) grows with beta in all directions, along the path too"
        yield Claim(f"sec. 4, {terminal}", claim, finding, _if(little, Verdict.SAME_ORDERING))


def _terminals(result: Result) -> Iterator[Claim]:
    better = []
    for error in ("te_um", "ce_um"):
        output, dare = (table_over_weights(result, terminal, error) for terminal in TERMINALS)
        better.append(sum(output[pair] < dare[pair] for pair in output))
    alphas, betas = _axes(result)
    count = len(alphas) * len(betas)
    finding = (
        f"output terminal better at {better[0]} of {count} weights in tracking, "
        f"{better[1]} in contour error; the paper compares measured errors, best against best"
    )
    claim = "H_s(Q_max) performs a little worse than the output terminal"
    holds = min(better) > count / 2
    yield Claim("Figs 7, 8", claim, finding, _if(holds, Verdict.SAME_ORDERING))


def _figure_9(result: Result) -> Iterator[Claim]:
    claim = f"tracking error falls up to {KNEE} samples of preview, then stays"
    for terminal in TERMINALS:
        previews, errors = over_previews(result, terminal, FIGURE_9, "te_um")
        at = dict(zip(previews, errors, strict=True))
        before = [at[n] for n in previews if n <= KNEE]
        after = [at[n] for n in previews if n > KNEE]
        level = all(abs(error / at[KNEE] - 1) <= STEADY for error in after)
        some = ", ".join(f"{at[n]:.4g} at {n}" for n in (1, 6, 8, KNEE))
        finding = f"{some}, then {min(after):.3g} to {max(after):.3g} um"
        if not _falls(before):
            finding += "; level from fewer samples on"
        best = Verdict.REPRODUCED if _falls(before) else Verdict.SAME_ORDERING
        yield Claim(f"Fig. 9, {terminal}", claim, finding, _if(level, best))


def _figure_10(result: Result) -> Iterator[Claim]:
    claim = "mean square contour error is the same at most preview lengths"
    for terminal in TERMINALS:
        previews, errors = over_previews(result, terminal, FIGURE_10, "ce_um")
        squares = [error**2 for error in errors]
        median = sorted(squares)[len(squares) // 2]
        near = sum(abs(square / median - 1) <= STEADY for square in squares)
        finding = (
            f"within {100 * STEADY:.0f} % of {median:.3g} um^2 at {near} of {len(previews)}; "
            f"{min(squares):.2g} to {max(squares):.2g}"
        )
        holds = near > len(previews) / 2
        if not holds:
            _, lag = over_previews(result, terminal, FIGURE_10, "te_um")
            finding += (
                f"; it lags by {lag[0]:.4g} um at preview {previews[0]}, "
                f"{lag[-1]:.3g} um at {previews[-1]}"
            )
        yield Claim(f"Fig. 10, {terminal}", claim, finding, _if(holds, Verdict.SAME_ORDERING))


def _theorem_1(result: Result) -> Iterator[Claim]:
    theorem = result.theorem_1
    largest = max(max(one.dare) for one in theorem.sets)
    finding = (
        f"{len(theorem.sets)} weight sets x {theorem.directions} directions x "
        f"horizons 1 to {theorem.longest}: largest radius {largest:.4f}"
    )
    claim = "H_s(Q_max) is stable on every line at every horizon"
    yield Claim("Theorem 1", claim, finding, _if(largest < 1, Verdict.REPRODUCED))
    bad = [loop for loop in theorem.unstable if loop.terminal == "output"]
    cases = len(theorem.sets) * theorem.longest
    finding = f"unstable in {len(bad)} of {cases} cases"
    if bad:
        horizons, rhos = {loop.preview for loop in bad}, {loop.rho for loop in bad}
        finding += f", horizon {listed(sorted(horizons))}, rho {listed(sorted(rhos))}"
    claim = "the output terminal carries no assurance, yet need not be unstable"
    yield Claim("sec. 3", claim, finding, _if(len(bad) < cases, Verdict.REPRODUCED))


def _trade(result: Result) -> Iterator[Claim]:
    claim = "less contour error for more tracking error"
    for before, after in (result.table_1[:2], result.table_1[2:4]):
        contour = (before.ce_um.ours, after.ce_um.ours)
        tracking = (before.te_um.ours, after.te_um.ours)
        finding = (
            f"contour {contour[0]:.3f} to {contour[1]:.3f} um, "
            f"tracking {tracking[0]:.3f} to {tracking[1]:.3f} um"
        )
        holds = contour[1] < contour[0] and tracking[1] > tracking[0]
        item = f"Table 1, {before.case} to {after.case}"
        yield Claim(item, claim, finding, _if(holds, Verdict.SAME_ORDERING))


def _finite_preview(result: Result) -> Iterator[Claim]:
    found = result.finite_preview
    held, kept = (_both(found.nominal[name]) for name in ("case III, path held", "case III"))
    finding = (
        f"gains agree to {found.largest_gain_difference:.0e} with the Appendix continuation; "
        f"a path held at its end gives {held} um in place of {kept}"
    )
    equal = found.largest_gain_difference <= EQUAL
    claim = "finite preview is case III"
    yield Claim("Table 1, last row", claim, finding, _if(equal, Verdict.REPRODUCED))


def _both(run: MachineRun) -> str:
    return f"{run.te_um:.3f}/{run.ce_um:.3f}"


def _line(result: Result) -> Iterator[Claim]:
    for terminal in TERMINALS:
        for alpha in sorted({run.alpha for run in result.line}):
            wanted = (terminal, alpha)
            runs = [run for run in result.line if (run.terminal, run.alpha) == wanted]
            yield _on_line(terminal, alpha, runs)


def _on_line(terminal: str, alpha: float, runs: Sequence[CaseRun]) -> Claim:
    errors = [run.machines[0].ce_um for run in runs]
    betas = [run.beta for run in runs]
    finding = f"alpha {alpha:g}, beta {listed(betas)}: {listed(errors)} um"
    if not _falls(errors):
        finding += "; a steady offset that the cost of a constant u leaves"
    claim = "contour error falls as contour weight grows"
    verdict = _if(_falls(errors), Verdict.SAME_ORDERING)
    return Claim(f"line at 37 deg, {terminal}", claim, finding, verdict)


def _axes(result: Result) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Alphas and betas of the grid."""
    return result.weights.alpha, result.weights.beta


def listed(values: Iterable[float | None]) -> str:
    """Values to three digits, with commas."""
    return ", ".join("diverged" if value is None else f"{value:.3g}" for value in values)


def _falls(values: Sequence[float | None]) -> bool:
    """Whether each value is below the one before; a diverged run (None) does not fall."""
    return all(a is not None and b is not None and b < a for a, b in pairwise(values))


def _if(holds: bool, verdict: Verdict) -> Verdict:
    return verdict if holds else Verdict.NOT_REPRODUCED
