"""Statements of McNab & Tsao: findings, verdicts, tables and figures."""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.mcnab_tsao.experiment import (
    ALPHAS,
    BETAS,
    FAMILY,
    FIGURE_2_ALPHA,
    FIGURE_9,
    FIGURE_10,
    LINE_ALPHA,
    LINE_SCALES,
    TERMINALS,
    THEOREM_HORIZON,
    THEOREM_WEIGHTS,
    TOO_HIGH_ALPHA,
    MachineRun,
    Result,
)
from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, Verdict, falls, in_order, listed, verdict
from experiments.tables import Table

STEADY = 0.25  # relative spread that still counts as constant in Figs 9 and 10
KNEE = 9  # [samples] the preview after which the paper sees no gain (its section 4)
LITTLE = 1 / 3  # relative change that still counts as little effect
EQUAL = 1e-9  # relative
CIRCLE_UM = 1e3  # radius


MEASURED = {
    ("output", "te_um"): "Fig. 3",
    ("output", "ce_um"): "Fig. 5",
    ("dare", "te_um"): "Fig. 7",
    ("dare", "ce_um"): "Fig. 8",
}


class Row(NamedTuple):
    """Row of Table 1: RMS errors in print, over one lap of the circle on the machine, and ours."""

    name: str
    terminal: str
    alpha: float
    beta: float
    te_um: float
    ce_um: float
    ours: MachineRun


PUBLISHED = (
    ("I", "output", 8.0, 0.0, 3.35, 3.07),
    ("II", "output", 1.2, 20.0, 43.07, 1.07),
    ("III", "dare", 3.0, 0.0, 4.10, 3.78),
    ("IV", "dare", 0.25, 15.0, 6.55, 1.70),
    ("finite preview", "dare", 3.0, 0.0, 4.10, 3.78),
)


def table_1(result: Result) -> list[Row]:
    """The paper's rows with ours beside them: measurements, shown and not matched."""
    runs = [result.on_family(*row[1:4])[0] for row in PUBLISHED[:-1]]
    runs.append(result.finite_preview["finite preview"])
    return [Row(*row, ours) for row, ours in zip(PUBLISHED, runs, strict=True)]


def claims(result: Result) -> Iterator[Claim]:
    """All that the paper shows or states beside the numbers of Table 1."""
    errors = [result.on_family("output", FIGURE_2_ALPHA, beta)[0].ce_um for beta in BETAS]
    yield Claim(
        "Fig. 2",
        "contour weight moves the points onto the circle",
        f"RMS contour error {listed(errors)} um at beta {listed(BETAS)} "
        f"(alpha {FIGURE_2_ALPHA:g}, output terminal)",
        verdict(falls(errors)),
    )
    yield from _measured_figures(result)
    yield from _over_the_weights(result)
    yield from _over_the_preview(result)
    yield from _theorem_1_and_table_1(result)
    for terminal, scale in product(TERMINALS, LINE_SCALES):
        case = (terminal, scale * LINE_ALPHA)
        runs = [run for run in result.line if (run.case.terminal, run.case.alpha) == case]
        errors = [run.machines[0].ce_um for run in runs]
        offset = "" if falls(errors) else "; a steady offset that the cost of a constant u leaves"
        yield Claim(
            f"line at 37 deg, {terminal}",
            "contour error falls as contour weight grows",
            f"alpha {case[1]:g}, beta {listed(run.case.beta for run in runs)}: "
            f"{listed(errors)} um{offset}",
            in_order(falls(errors)),
        )


def _measured_figures(result: Result) -> Iterator[Claim]:
    """U-shape over alpha on the machine that is latest."""
    alphas, delay = (*ALPHAS, TOO_HIGH_ALPHA), FAMILY[-1].delay
    for (terminal, error), figure in MEASURED.items():
        runs = {alpha: result.on_family(terminal, alpha, 0.0) for alpha in alphas}
        late = {alpha: machines[-1] for alpha, machines in runs.items()}
        stable = {alpha: getattr(run, error) for alpha, run in late.items() if run.stable}
        lost = [
            f"{a:g} (radius {run.spectral_radius:.4f})" for a, run in late.items() if not run.stable
        ]
        least, best = min(((value, a) for a, value in stable.items()), default=(np.nan, alphas[0]))
        finding = f"delay {delay}, beta 0: least {least:.3g} um at alpha {best:g}, "
        if lost:
            finding += f"unstable at alpha {' and '.join(lost)}"
        else:
            finding += f"{stable[alphas[-1]]:.3g} um at {alphas[-1]:g}"
        if falls([getattr(machines[0], error) for machines in runs.values()]):
            finding += "; the nominal machine only improves"
        claim = "measured errors fall with the weight, then rise"
        yield Claim(figure, claim, finding, in_order(alphas[0] < best < alphas[-1]))


def _over_the_weights(result: Result) -> Iterator[Claim]:
    """Figs 4 and 6 to 8, and section 4, on the nominal machine; arrays have axes (alpha, beta)."""
    tracking = {terminal: result.over_weights(terminal, "te_um") for terminal in TERMINALS}
    contour = {terminal: result.over_weights(terminal, "ce_um") for terminal in TERMINALS}
    first, last = tracking["output"][[0, -1], 0]
    yield Claim(
        "Fig. 4",
        "simulated tracking error falls as weights grow (no numbers given)",
        f"over alpha {first:.4g} to {last:.4g} um at beta {BETAS[0]:g}",
        in_order(all(map(falls, tracking["output"].T))),
    )
    for terminal, item in (("output", "Fig. 6"), ("dare", "as Fig. 6, H_s")):
        claim = "simulated contour error falls as contour weight grows (no numbers given)"
        rows = dict(zip(ALPHAS, contour[terminal], strict=True))
        good = [alpha for alpha in ALPHAS if falls(rows[alpha])]
        if good:
            last = good[-1]
            finding = f"at alpha {listed(good)}; at {last:g}: {listed(rows[last])} um over beta"
            yield Claim(item, claim, finding, in_order(True))
        for alpha in ALPHAS:
            if alpha in good:
                continue
            runs = [result.on_family(terminal, alpha, beta)[0] for beta in BETAS]
            finding = f"alpha {alpha:g}: {listed(rows[alpha])} um"
            if falls([run.projected_um for run in runs]):
                lag = runs[-1].te_um  # along the tangent it leaves the circle
                finding += (
                    f"; eq. 3's error does fall, but a lag of {lag:.3g} um lies "
                    f"{lag**2 / (2 * CIRCLE_UM):.2g} um off a 1 mm circle"
                )
            yield Claim(item, claim, finding, in_order(False))
    for terminal in TERMINALS:
        claim = "tracking weight lowers the contour error too"
        columns = dict(zip(BETAS, contour[terminal].T, strict=True))
        good = [beta for beta in BETAS if falls(columns[beta])]
        others = [beta for beta in BETAS if beta not in good]
        if good:
            yield Claim(f"sec. 4, {terminal}", claim, f"at beta {listed(good)}", in_order(True))
        if others:
            finding = (
                f"at beta {listed(others)}: the contour weight rules it, "
                f"{listed(columns[others[-1]])} um over alpha at {others[-1]:g}"
            )
            yield Claim(f"sec. 4, {terminal}", claim, finding, in_order(False))
    for terminal in TERMINALS:
        change = np.abs(tracking[terminal] / tracking[terminal][:, :1] - 1).max(axis=1)
        worst = int(np.argmax(change))
        little = bool(change[worst] <= LITTLE)
        finding = f"changes by at most {100 * change[worst]:.0f} % over beta "
        finding += f"(at alpha {ALPHAS[worst]:g})"
        if terminal == "dare" and not little:
            finding += "; H_s(Q_max) grows with beta in all directions, along the path too"
        claim = "contour weight hardly changes the tracking error"
        yield Claim(f"sec. 4, {terminal}", claim, finding, in_order(little))
    better = [int(np.sum(error["output"] < error["dare"])) for error in (tracking, contour)]
    count = len(ALPHAS) * len(BETAS)
    yield Claim(
        "Figs 7, 8",
        "H_s(Q_max) performs a little worse than the output terminal",
        f"output terminal better at {better[0]} of {count} weights in tracking, "
        f"{better[1]} in contour error; the paper compares measured errors, best against best",
        in_order(min(better) > count / 2),
    )


def _over_the_preview(result: Result) -> Iterator[Claim]:
    """Figs 9 and 10."""
    for terminal in TERMINALS:
        at = result.over_previews(terminal, FIGURE_9, "te_um")
        before = [error for n, error in at.items() if n <= KNEE]
        after = [error for n, error in at.items() if n > KNEE]
        level = all(abs(error / at[KNEE] - 1) <= STEADY for error in after)
        some = ", ".join(f"{at[n]:.4g} at {n}" for n in (1, 6, 8, KNEE))
        finding = f"{some}, then {min(after):.3g} to {max(after):.3g} um"
        if not falls(before):
            finding += "; level from fewer samples on"
        claim = f"tracking error falls up to {KNEE} samples of preview, then stays"
        fares = verdict(level) if falls(before) else in_order(level)
        yield Claim(f"Fig. 9, {terminal}", claim, finding, fares)
    for terminal in TERMINALS:
        errors = result.over_previews(terminal, FIGURE_10, "ce_um").values()
        squares = [error**2 for error in errors]
        median = sorted(squares)[len(squares) // 2]
        near = sum(abs(square / median - 1) <= STEADY for square in squares)
        finding = (
            f"within {100 * STEADY:.0f} % of {median:.3g} um^2 at {near} of {len(squares)}; "
            f"{min(squares):.2g} to {max(squares):.2g}"
        )
        holds = near > len(squares) / 2
        if not holds:
            lag = result.over_previews(terminal, FIGURE_10, "te_um")
            first, last = min(lag), max(lag)
            finding += (
                f"; it lags by {lag[first]:.4g} um at preview {first}, {lag[last]:.3g} um at {last}"
            )
        claim = "mean square contour error is the same at most preview lengths"
        yield Claim(f"Fig. 10, {terminal}", claim, finding, in_order(holds))


def _theorem_1_and_table_1(result: Result) -> Iterator[Claim]:
    """Theorem 1, the order of the rows of Table 1, and its last one."""
    output, dare = result.radii.swapaxes(0, 1)
    yield Claim(
        "Theorem 1",
        "H_s(Q_max) is stable on every line at every horizon",
        f"{len(dare)} weight sets x {result.directions} directions x "
        f"horizons 1 to {THEOREM_HORIZON}: largest radius {dare.max():.4f}",
        verdict(bool(dare.max() < 1)),
    )
    bad = np.argwhere(output >= 1).tolist()
    finding = f"unstable in {len(bad)} of {output.size} cases"
    if bad:
        horizons, rhos = {k + 1 for _, k in bad}, {THEOREM_WEIGHTS[one][2] for one, _ in bad}
        finding += f", horizon {listed(sorted(horizons))}, rho {listed(sorted(rhos))}"
    claim = "the output terminal carries no assurance, yet need not be unstable"
    yield Claim("sec. 3", claim, finding, verdict(len(bad) < output.size))
    rows = table_1(result)
    for before, after in (rows[:2], rows[2:4]):
        one, other = before.ours, after.ours
        yield Claim(
            f"Table 1, {before.name} to {after.name}",
            "less contour error for more tracking error",
            f"contour {one.ce_um:.3f} to {other.ce_um:.3f} um, "
            f"tracking {one.te_um:.3f} to {other.te_um:.3f} um",
            in_order(other.ce_um < one.ce_um and other.te_um > one.te_um),
        )
    runs = [result.finite_preview[name] for name in ("case III, path held", "case III")]
    held, kept = (f"{run.te_um:.3f}/{run.ce_um:.3f}" for run in runs)
    difference = result.largest_gain_difference
    yield Claim(
        "Table 1, last row",
        "finite preview is case III",
        f"gains agree to {difference:.0e} with the Appendix continuation; "
        f"a path held at its end gives {held} um in place of {kept}",
        verdict(difference <= EQUAL),
    )


def tables(result: Result) -> Iterator[Table]:
    """Table 1."""
    yield Table(
        "Table 1: RMS errors over a lap of the circle [um], "
        "the machine (paper) beside the simulation (ours)",
        table_1(result),
        {
            "case": "name",
            "weights": lambda row: f"{row.terminal}\n{row.alpha:g}/{row.beta:g}",
            "te\npaper": "te_um:.2f",
            "te\nours": "ours.te_um:.3f",
            "te\nratio": lambda row: f"{row.ours.te_um / row.te_um:.2f}",
            "ce\npaper": "ce_um:.2f",
            "ce\nours": "ours.ce_um:.3f",
            "ce\nratio": lambda row: f"{row.ours.ce_um / row.ce_um:.2f}",
            "verdict": lambda row: Verdict.EXPERIMENTAL,
        },
        words=2,
    )


NAMES = {"output": "output terminal C'QC", "dare": "terminal H_s(Q_max)"}
COLOURS = {"output": "tab:blue", "dare": "tab:orange"}
ERRORS = {"te_um": "tracking", "ce_um": "contour"}  # rows of a figure
SHADES = ("#c6dbef", "#9ecae1", "#6baed6", "#3182bd", "#08519c")  # beta, light to dark
POINT_COLOURS = ("tab:red", "tab:orange", "tab:olive", "tab:green", "tab:blue")
REACH = 60.0  # [um] of Fig. 2: five samples, the points of one sample stay apart
CROSS = {"marker": "X", "markersize": 10, "linestyle": ""}
LOG = {"xscale": "log", "yscale": "log"}
SIMULATED = {("output", "te_um"): "Fig. 4: ", ("output", "ce_um"): "Fig. 6: "}


def points_along_the_circle(result: Result) -> Figure:
    """Fig. 2: output samples approach the circle as contour weight is added."""
    desired = 1e6 * result.desired_m
    middle = desired[len(desired) // 2]
    angle = np.linspace(0.0, 2 * np.pi, 20_001)
    circle = 1e3 * np.column_stack([np.cos(angle), np.sin(angle)]) - middle
    ring = {"marker": "o", "linestyle": "", "color": "0.2", "mfc": "none", "markersize": 8}
    curves = [
        Curve(*circle.T, "circle", {"color": "0.6", "linewidth": 1.0}),
        Curve(*(desired - middle).T, "desired", ring),
    ]
    for colour, (beta, output) in zip(POINT_COLOURS, result.output_m.items(), strict=False):
        cross = {"marker": "x", "linestyle": "", "color": colour, "markersize": 7}
        curves.append(Curve(*(1e6 * output - middle).T, f"beta {beta}", cross))
    title = (
        "Fig. 2: samples on the 1 mm circle, motion to the lower left\n"
        f"alpha {FIGURE_2_ALPHA:g}, output terminal"
    )
    limits = (-REACH, REACH)
    axes = {"xlim": limits, "ylim": limits, "aspect": "equal"}
    return drawn([Panel(title, "x [um]", "y [um]", curves, axes)], (6.5, 6.0), legend=4)


def errors_over_the_weights(result: Result) -> Figure:
    """Figs 4 and 6, and the same with H_s: nominal machine."""
    panels = []
    for error, terminal in product(ERRORS, NAMES):
        values = result.over_weights(terminal, error)
        curves = [
            Curve(ALPHAS, values[:, k], f"beta {beta:g}", {"color": SHADES[k], "marker": "o"})
            for k, beta in enumerate(BETAS)
        ]
        number = SIMULATED.get((terminal, error), "")
        title = f"{number}RMS {ERRORS[error]} error, {NAMES[terminal]}"
        panels.append(Panel(title, "alpha", "[um]", curves, LOG))
    return drawn(panels, (11.0, 7.5), columns=2, legend=5, sharex=True, sharey="row")


def errors_on_the_family(result: Result) -> Figure:
    """Figs 3, 5, 7 and 8: errors over alpha on every machine; crosses where a loop is unstable."""
    panels, alphas = [], np.array([*ALPHAS, TOO_HIGH_ALPHA])
    for error, terminal in product(ERRORS, NAMES):
        runs = [result.on_family(terminal, alpha, 0.0) for alpha in alphas]
        curves = []
        for i, member in enumerate(FAMILY):
            values = np.array([getattr(machines[i], error) for machines in runs])
            lost = np.array([not machines[i].stable for machines in runs])
            curves += [
                Curve(alphas, values, member.name, {"color": f"C{i}", "marker": "."}),
                Curve(alphas[lost], values[lost], None, {"color": f"C{i}", **CROSS}),
            ]
        title = f"{MEASURED[terminal, error]}: RMS {ERRORS[error]} error, {NAMES[terminal]}, beta 0"
        panels.append(Panel(title, "alpha", "[um]", curves, LOG))
    return drawn(panels, (11.0, 7.5), columns=2, legend=5, sharex=True, sharey="row")


def errors_over_the_preview(result: Result) -> Figure:
    """Figs 9 and 10: errors against the number of preview samples, both terminals."""
    tracking, square = [], []
    for terminal, name in NAMES.items():
        style = {"marker": "+", "color": COLOURS[terminal]}
        te = result.over_previews(terminal, FIGURE_9, "te_um")
        ce = result.over_previews(terminal, FIGURE_10, "ce_um")
        tracking.append(Curve(list(te), list(te.values()), name, style))
        square.append(Curve(list(ce), np.square(list(ce.values())), name, style))
    titles = (
        "Fig. 9: RMS tracking error, alpha 4, beta 0",
        "Fig. 10: mean square contour error, alpha 0.25, beta 15",
    )
    x, axes = "preview [samples]", {"yscale": "log"}
    panels = [
        Panel(titles[0], x, "[um]", tracking, axes),
        Panel(titles[1], x, "[um^2]", square, axes),
    ]
    return drawn(panels, (11.0, 4.5), columns=2, legend=2)


FIGURES = {
    "figure-2": points_along_the_circle,
    "figures-3-and-5": errors_on_the_family,
    "figures-4-and-6": errors_over_the_weights,
    "figures-9-and-10": errors_over_the_preview,
}
