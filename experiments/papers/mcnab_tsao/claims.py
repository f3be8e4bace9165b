"""What McNab & Tsao say, what the simulation says, and the verdict. Every finding is worked out from the numbers of the run."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

from experiments.papers.verdicts import Verdict

STEADY = 0.25  # relative spread that still counts as constant in Figs 9 and 10
KNEE = 9  # [samples] the preview after which the paper sees no gain (its section 4)
LITTLE = 1 / 3  # relative change that still counts as little effect
EQUAL = 1e-9  # relative
FIGURE_2_ALPHA = (
    1.2  # the largest of the paper's at which the points of Fig. 2 can still be told apart
)
FIGURE_9, FIGURE_10 = (4.0, 0.0), (0.25, 15.0)  # the paper's alpha, beta

Claim = dict[str, str]  # item, claim, finding, verdict


def table_1(published: Iterable[Any], summary: dict[str, Any]) -> list[dict[str, Any]]:
    """The paper's rows with ours beside them: all measured on the machine, none to be matched."""
    rows = []
    for row in published:
        finite = row.case == "finite preview"
        run = run_of(summary, row.terminal, row.alpha, row.beta)["machines"][0]
        ours = summary["finite_preview"]["nominal"][row.case] if finite else run
        theirs = row._asdict()
        errors = {
            e: {"paper": theirs[e], "ours": ours[e], "ratio": ours[e] / theirs[e]}
            for e in ("te_um", "ce_um")
        }
        rows.append({**theirs, **errors, "verdict": Verdict.EXPERIMENTAL.value})
    return rows


def run_of(
    summary: dict[str, Any], terminal: str, alpha: float, beta: float, preview: int = 10
) -> dict[str, Any]:
    """The run of one controller on the circle."""
    wanted = (terminal, alpha, beta, preview)
    return next(
        run
        for run in summary["runs"]
        if (run["terminal"], run["alpha"], run["beta"], run["preview"]) == wanted
    )


def nominal(summary: dict[str, Any], terminal: str, error: str) -> dict[tuple[float, float], float]:
    """One error on the nominal machine over the weight grid, by (alpha, beta)."""
    alphas, betas = summary["weights"]["alpha"], summary["weights"]["beta"]
    return {
        (alpha, beta): run_of(summary, terminal, alpha, beta)["machines"][0][error]
        for alpha in alphas
        for beta in betas
    }


def scan(
    summary: dict[str, Any], terminal: str, alpha: float, beta: float, error: str
) -> tuple[list[int], list[float]]:
    """Preview lengths, and one error on the nominal machine."""
    runs = [
        run
        for run in summary["runs"]
        if (run["terminal"], run["alpha"], run["beta"]) == (terminal, alpha, beta)
    ]
    runs.sort(key=lambda run: run["preview"])
    return [run["preview"] for run in runs], [run["machines"][0][error] for run in runs]


def claims(summary: dict[str, Any]) -> list[Claim]:
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
    return [row for part in parts for row in part(summary)]


def _row(item: str, claim: str, finding: str, verdict: Verdict) -> Claim:
    return {"item": item, "claim": claim, "finding": finding, "verdict": verdict.value}


def _figure_2(summary) -> Iterator[Claim]:
    betas = summary["weights"]["beta"]
    errors = [
        run_of(summary, "output", FIGURE_2_ALPHA, beta)["machines"][0]["ce_um"] for beta in betas
    ]
    finding = f"RMS contour error {listed(errors)} um at beta {listed(betas)} (alpha {FIGURE_2_ALPHA:g}, output terminal)"
    yield _row(
        "Fig. 2",
        "contour weight moves the points onto the circle",
        finding,
        _if(_falls(errors), Verdict.REPRODUCED),
    )


def _measured_figures(summary) -> Iterator[Claim]:
    alphas, delay = (
        [*summary["weights"]["alpha"], summary["weights"]["too_high_alpha"]],
        summary["family"][-1]["delay"],
    )
    numbers = {
        "Fig. 3": ("output", "te_um"),
        "Fig. 5": ("output", "ce_um"),
        "Fig. 7": ("dare", "te_um"),
        "Fig. 8": ("dare", "ce_um"),
    }
    for figure, (terminal, error) in numbers.items():
        runs = {alpha: run_of(summary, terminal, alpha, 0.0)["machines"] for alpha in alphas}
        stable = {
            alpha: machines[-1][error]
            for alpha, machines in runs.items()
            if machines[-1]["spectral_radius"] < 1
        }
        lost = [
            f"{alpha:g} (radius {runs[alpha][-1]['spectral_radius']:.4f})"
            for alpha in alphas
            if alpha not in stable
        ]
        best = min(stable, key=lambda alpha: stable[alpha], default=alphas[0])
        finding = f"delay {delay}, beta 0: least {stable.get(best, float('nan')):.3g} um at alpha {best:g}, "
        finding += (
            f"unstable at alpha {' and '.join(lost)}"
            if lost
            else f"{stable[alphas[-1]]:.3g} um at {alphas[-1]:g}"
        )
        finding += (
            "; the nominal machine only improves"
            if _falls([machines[0][error] for machines in runs.values()])
            else ""
        )
        holds = alphas[0] < best < alphas[-1]
        yield _row(
            figure,
            "measured errors fall with the weight, then rise",
            finding,
            _if(holds, Verdict.SAME_ORDERING),
        )


def _figure_4(summary) -> Iterator[Claim]:
    table, alphas, betas = _grid(summary, "output", "te_um")
    holds = all(_falls([table[alpha, beta] for alpha in alphas]) for beta in betas)
    ends = f"{table[alphas[0], betas[0]]:.4g} to {table[alphas[-1], betas[0]]:.4g} um at beta {betas[0]:g}"
    finding = f"{'falls' if holds else 'does not always fall'} with alpha, {ends}"
    yield _row(
        "Fig. 4",
        "simulated tracking error falls as weights grow (no numbers given)",
        finding,
        _if(holds, Verdict.SAME_ORDERING),
    )


def _figure_6(summary) -> Iterator[Claim]:
    claim = "simulated contour error falls as contour weight grows (no numbers given)"
    for terminal, item in (("output", "Fig. 6"), ("dare", "as Fig. 6, H_s")):
        true, alphas, betas = _grid(summary, terminal, "ce_um")
        projected, lag = (nominal(summary, terminal, error) for error in ("projected_um", "te_um"))
        rows = {alpha: [true[alpha, beta] for beta in betas] for alpha in alphas}
        holds = [alpha for alpha in alphas if _falls(rows[alpha])]
        if holds:
            finding = f"at alpha {listed(holds)}; at {holds[-1]:g}: {listed(rows[holds[-1]])} um over beta"
            yield _row(item, claim, finding, Verdict.SAME_ORDERING)
        for alpha in (alpha for alpha in alphas if alpha not in holds):
            finding, behind = f"alpha {alpha:g}: {listed(rows[alpha])} um", lag[alpha, betas[-1]]
            if _falls([projected[alpha, beta] for beta in betas]):
                finding += f"; eq. 3's error does fall, but a lag of {behind:.3g} um lies {behind**2 / 2e3:.2g} um off a 1 mm circle"
            yield _row(item, claim, finding, Verdict.NOT_REPRODUCED)


def _tracking_weight(summary) -> Iterator[Claim]:
    claim = "tracking weight lowers the contour error too"
    for terminal in ("output", "dare"):
        table, alphas, betas = _grid(summary, terminal, "ce_um")
        holds = [beta for beta in betas if _falls([table[alpha, beta] for alpha in alphas])]
        others = [beta for beta in betas if beta not in holds]
        if holds:
            yield _row(
                f"sec. 4, {terminal}", claim, f"at beta {listed(holds)}", Verdict.SAME_ORDERING
            )
        if others:
            errors = [table[alpha, others[-1]] for alpha in alphas]
            finding = f"at beta {listed(others)}: the contour weight rules it, {listed(errors)} um over alpha at {others[-1]:g}"
            yield _row(f"sec. 4, {terminal}", claim, finding, Verdict.NOT_REPRODUCED)


def _little_effect(summary) -> Iterator[Claim]:
    for terminal in ("output", "dare"):
        table, alphas, betas = _grid(summary, terminal, "te_um")
        change = {
            alpha: max(abs(table[alpha, beta] / table[alpha, betas[0]] - 1) for beta in betas)
            for alpha in alphas
        }
        worst = max(change, key=lambda alpha: change[alpha])
        little = change[worst] <= LITTLE
        finding = f"changes by at most {100 * change[worst]:.0f} % over beta (at alpha {worst:g})"
        finding += (
            ""
            if terminal == "output" or little
            else "; H_s(Q_max) grows with beta in all directions, along the path too"
        )
        yield _row(
            f"sec. 4, {terminal}",
            "contour weight hardly changes the tracking error",
            finding,
            _if(little, Verdict.SAME_ORDERING),
        )


def _terminals(summary) -> Iterator[Claim]:
    better = []
    for error in ("te_um", "ce_um"):
        output, dare = (nominal(summary, terminal, error) for terminal in ("output", "dare"))
        better.append(sum(output[pair] < dare[pair] for pair in output))
    count = len(summary["weights"]["alpha"]) * len(summary["weights"]["beta"])
    finding = f"output terminal better at {better[0]} of {count} weights in tracking, {better[1]} in contour error; the paper compares "
    finding += "measured errors, best against best"
    claim = "H_s(Q_max) performs a little worse than the output terminal"
    yield _row("Figs 7, 8", claim, finding, _if(min(better) > count / 2, Verdict.SAME_ORDERING))


def _figure_9(summary) -> Iterator[Claim]:
    for terminal in ("output", "dare"):
        previews, errors = scan(summary, terminal, *FIGURE_9, "te_um")
        at = dict(zip(previews, errors, strict=True))
        before, after = (
            [at[n] for n in previews if n <= KNEE],
            [at[n] for n in previews if n > KNEE],
        )
        level = all(abs(error / at[KNEE] - 1) <= STEADY for error in after)
        finding = (
            ", ".join(f"{at[n]:.4g} at {n}" for n in (1, 6, 8, KNEE))
            + f", then {min(after):.3g} to {max(after):.3g} um"
        )
        finding += "" if _falls(before) else "; level from fewer samples on"
        verdict = _if(level, Verdict.REPRODUCED if _falls(before) else Verdict.SAME_ORDERING)
        yield _row(
            f"Fig. 9, {terminal}",
            f"tracking error falls up to {KNEE} samples of preview, then stays",
            finding,
            verdict,
        )


def _figure_10(summary) -> Iterator[Claim]:
    for terminal in ("output", "dare"):
        previews, errors = scan(summary, terminal, *FIGURE_10, "ce_um")
        squares = [error**2 for error in errors]
        median = sorted(squares)[len(squares) // 2]
        near = sum(abs(square / median - 1) <= STEADY for square in squares)
        finding = f"within {100 * STEADY:.0f} % of {median:.3g} um^2 at {near} of {len(previews)}; {min(squares):.2g} to {max(squares):.2g}"
        lag, holds = scan(summary, terminal, *FIGURE_10, "te_um")[1], near > len(previews) / 2
        finding += (
            ""
            if holds
            else f"; it lags by {lag[0]:.4g} um at preview {previews[0]}, {lag[-1]:.3g} um at {previews[-1]}"
        )
        claim = "mean square contour error is the same at most preview lengths"
        yield _row(f"Fig. 10, {terminal}", claim, finding, _if(holds, Verdict.SAME_ORDERING))


def _theorem_1(summary) -> Iterator[Claim]:
    theorem, sets = summary["theorem_1"], summary["theorem_1"]["sets"]
    largest = max(max(one["dare"]) for one in sets)
    loops = f"{len(sets)} weight sets x {theorem['directions']} directions x horizons 1 to {theorem['longest']}"
    finding = f"{loops}: largest radius {largest:.4f}"
    yield _row(
        "Theorem 1",
        "H_s(Q_max) is stable on every line at every horizon",
        finding,
        _if(largest < 1, Verdict.REPRODUCED),
    )
    bad, cases = (
        [case for case in theorem["unstable"] if case["terminal"] == "output"],
        len(sets) * theorem["longest"],
    )
    horizons, rhos = (
        sorted({case["preview"] for case in bad}),
        sorted({case["rho"] for case in bad}),
    )
    finding = f"unstable in {len(bad)} of {cases} cases" + (
        f", horizon {listed(horizons)}, rho {listed(rhos)}" if bad else ""
    )
    claim = "the output terminal carries no assurance, yet need not be unstable"
    yield _row("sec. 3", claim, finding, _if(len(bad) < cases, Verdict.REPRODUCED))


def _trade(summary) -> Iterator[Claim]:
    for a, b in (summary["table_1"][:2], summary["table_1"][2:4]):
        contour, tracking = ([row[error]["ours"] for row in (a, b)] for error in ("ce_um", "te_um"))
        finding = f"contour {contour[0]:.3f} to {contour[1]:.3f} um, tracking {tracking[0]:.3f} to {tracking[1]:.3f} um"
        holds = contour[1] < contour[0] and tracking[1] > tracking[0]
        claim = "less contour error for more tracking error"
        yield _row(
            f"Table 1, {a['case']} to {b['case']}",
            claim,
            finding,
            _if(holds, Verdict.SAME_ORDERING),
        )


def _finite_preview(summary) -> Iterator[Claim]:
    runs, difference = (
        summary["finite_preview"]["nominal"],
        summary["finite_preview"]["largest_gain_difference"],
    )
    held, kept = (
        f"{runs[name]['te_um']:.3f}/{runs[name]['ce_um']:.3f}"
        for name in ("case III, path held", "case III")
    )
    finding = f"gains agree to {difference:.0e} with the Appendix continuation; a path held at its end gives {held} um in place of {kept}"
    yield _row(
        "Table 1, last row",
        "finite preview is case III",
        finding,
        _if(difference <= EQUAL, Verdict.REPRODUCED),
    )


def _line(summary) -> Iterator[Claim]:
    claim = "contour error falls as contour weight grows"
    for terminal in ("output", "dare"):
        for alpha in sorted({run["alpha"] for run in summary["line"]}):
            runs = [
                run
                for run in summary["line"]
                if (run["terminal"], run["alpha"]) == (terminal, alpha)
            ]
            errors, betas = (
                [run["machines"][0]["ce_um"] for run in runs],
                [run["beta"] for run in runs],
            )
            finding = f"alpha {alpha:g}, beta {listed(betas)}: {listed(errors)} um"
            finding += (
                "" if _falls(errors) else "; a steady offset that the cost of a constant u leaves"
            )
            yield _row(
                f"line at 37 deg, {terminal}",
                claim,
                finding,
                _if(_falls(errors), Verdict.SAME_ORDERING),
            )


def _grid(
    summary, terminal: str, error: str
) -> tuple[dict[tuple[float, float], float], list[float], list[float]]:
    return (
        nominal(summary, terminal, error),
        summary["weights"]["alpha"],
        summary["weights"]["beta"],
    )


def listed(values: Iterable[float]) -> str:
    """Values to three digits, with commas."""
    return ", ".join(f"{value:.3g}" for value in values)


def _falls(values: Sequence[float | None]) -> bool:
    """Each value below the one before; a diverged run (None) does not fall."""
    return all(a is not None and b is not None and b < a for a, b in pairwise(values))


def _if(holds: bool, verdict: Verdict) -> Verdict:
    return verdict if holds else Verdict.NOT_REPRODUCED
