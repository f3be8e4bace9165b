"""McNab & Tsao 2000: receding-horizon LQ contouring on an X-Y table, every table, figure and theorem beside ours.

Only their simulated figures can be reproduced. Table 1 and Figs 3, 5, 7, 8 were measured on the
machine: our simulation is shown beside them and not fitted to them. What the machine does at high
weights, and their simulation does not, is sought in a family of machines with an input delay and
input gains that the controller does not know of.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.papers.mcnab_tsao.claims import (
    FIGURE_2_ALPHA,
    FIGURE_9,
    FIGURE_10,
    claims,
    table_1,
)
from experiments.papers.mcnab_tsao.figures import draw
from experiments.papers.mcnab_tsao.runs import (
    LONGEST,
    PREVIEW,
    RHO,
    Bench,
    Law,
    Run,
    family,
    radii_on_lines,
)
from experiments.papers.mcnab_tsao.tables import show
from jcontour.controllers.lq.contouring_lq import LQWeights

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "R. J. McNab, T.-C. Tsao: Receding Time Horizon Linear Quadratic Optimal Control for Multi-Axis Contour Tracking Motion Control. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 122 (2000)"
)


class Measured(NamedTuple):
    """A row of the paper's Table 1: RMS errors over one lap of the circle, measured on the machine."""

    case: str
    terminal: str
    alpha: float
    beta: float
    te_um: float
    ce_um: float


PUBLISHED = (
    Measured("I", "output", 8.0, 0.0, 3.35, 3.07),
    Measured("II", "output", 1.2, 20.0, 43.07, 1.07),
    Measured("III", "dare", 3.0, 0.0, 4.10, 3.78),
    Measured("IV", "dare", 0.25, 15.0, 6.55, 1.70),
    Measured("finite preview", "dare", 3.0, 0.0, 4.10, 3.78),
)

ALPHAS, BETAS = (
    (0.25, 0.5, 1.2, 3.0, 4.0, 8.0),
    (0.0, 1.0, 5.0, 15.0, 20.0),
)  # the paper's weights and what lies between
TOO_HIGH = 20.0  # an alpha beyond the paper's, for the U-shape
LINE_ALPHA, LINE_BETAS, LINE_SCALES = (
    3.0,
    (0.0, 1.0, 5.0, 20.0),
    (1.0, 10.0),
)  # 3/0 -> 3/5, and the same at ten times the weights
POINTS = slice(591, 602)  # samples near the circle's upper left, in the scored lap
THEOREM_ALPHAS, THEOREM_BETAS, THEOREM_RHOS = (
    (0.25, 3.0, 8.0),
    (0.0, 5.0, 15.0, 20.0),
    (RHO, RHO * 1e-2, RHO * 1e-4),
)
THEOREM_HORIZON, THEOREM_DIRECTIONS, QUICK_DIRECTIONS = (
    50,
    72,
    18,
)  # over half a turn: the weight is that of the opposite direction

Progress = Callable[[float, str], None]  # (part done, what is being done)


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce mcnab-tsao`."""

    quick: bool = False
    """Finish within a minute: Theorem 1 in 18 directions in place of 72, all else as ever."""
    delay: int = 2
    """Largest input delay [samples] of the family of machines behind Figs 3, 5, 7 and 8; the controller does not know of it."""
    gain_error: float = 0.1
    """Input gain error of the family: one axis stronger by this part and the other weaker, and the other way round."""

    def __post_init__(self):
        if self.delay < 1:
            raise ValueError(f"delay: needs at least one sample, received {self.delay}")
        if not 0 <= self.gain_error < 1:
            raise ValueError(f"gain_error: needs a part from 0 up to 1, received {self.gain_error}")


def run(settings: Settings, folder: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Simulate everything; all that is found is in the summary, nothing is written to the folder."""
    tell = progress or (lambda part, doing: None)
    tell(0.0, "compiling")
    bench = Bench(family(settings.gain_error, settings.delay))
    laws = _laws()
    runs, points = (
        [],
        {"desired_m": np.asarray(bench.circle.position[POINTS]).tolist(), "output_m": {}},
    )
    for k, law in enumerate(laws):
        tell(
            0.1 + 0.5 * k / len(laws),
            f"circle, {law.terminal} terminal, {law.alpha:g}/{law.beta:g}, preview {law.preview}",
        )
        found = bench.run(bench.plan(law, bench.circle), bench.circle)
        runs.append(_row(law, found))
        if (law.terminal, law.alpha, law.preview) == ("output", FIGURE_2_ALPHA, PREVIEW):
            points["output_m"][f"{law.beta:g}"] = found.output[0, POINTS].tolist()
    tell(0.6, "line")
    line_laws = [
        Law(t, s * LINE_ALPHA, s * beta)
        for t in bench.terminals
        for s in LINE_SCALES
        for beta in LINE_BETAS
    ]
    line = [_row(law, bench.run(bench.plan(law, bench.line), bench.line)) for law in line_laws]
    tell(0.65, "finite preview")
    finite_preview = _finite_preview(bench)
    tell(0.7, "Theorem 1")
    summary: dict[str, Any] = {
        "source": SOURCE,
        "settings": asdict(settings),
        "weights": {
            "alpha": list(ALPHAS),
            "beta": list(BETAS),
            "rho": RHO,
            "too_high_alpha": TOO_HIGH,
        },
        "family": [machine._asdict() for machine in bench.family],
        "runs": runs,
        "points": points,
        "line": line,
        "finite_preview": finite_preview,
        "theorem_1": _theorem_1(bench, QUICK_DIRECTIONS if settings.quick else THEOREM_DIRECTIONS),
    }
    summary["table_1"] = table_1(PUBLISHED, summary)
    summary["claims"] = claims(summary)
    tell(1.0, "done")
    return summary


def _laws() -> list[Law]:
    previews = range(1, LONGEST + 1)
    grid = [
        Law(terminal, alpha, beta)
        for terminal in ("output", "dare")
        for alpha in ALPHAS
        for beta in BETAS
    ]
    grid += [Law(terminal, TOO_HIGH, 0.0) for terminal in ("output", "dare")]
    scan = [
        Law(terminal, *weights, n)
        for weights in (FIGURE_9, FIGURE_10)
        for terminal in ("output", "dare")
        for n in previews
    ]
    return list(dict.fromkeys(grid + scan))  # N_p = 10 is in both


def _row(law: Law, found: Run) -> dict[str, Any]:
    metrics = found.metrics
    columns = {
        "te_um": 1e6 * np.asarray(metrics.rms_tracking_error),
        "ce_um": 1e6 * np.asarray(metrics.rms_contour_error),
        "projected_um": 1e6 * np.asarray(metrics.rms_projected_error),
        "control": np.asarray(metrics.rms_control),
        "increment": np.asarray(metrics.rms_increment),
    }
    lost = np.asarray(metrics.diverged)
    machines = [
        {
            "spectral_radius": float(radius),
            "diverged": bool(lost[i]),
            **{k: None if lost[i] else float(v[i]) for k, v in columns.items()},
        }
        for i, radius in enumerate(found.spectral_radius)
    ]
    return {**law._asdict(), "machines": machines}


def _finite_preview(bench: Bench) -> dict[str, Any]:
    """Tomizuka & Whitney's controller beside case III, and case III without the Appendix continuation."""
    case_iii = Law("dare", 3.0, 0.0)
    plans = {
        "finite preview": bench.plan_finite_preview(case_iii.alpha, bench.circle),
        "case III": bench.plan(case_iii, bench.circle),
        "case III, path held": bench.plan_holding(case_iii, bench.circle),
    }
    nominal = {
        name: _row(case_iii, bench.run(plan, bench.circle))["machines"][0]
        for name, plan in plans.items()
    }
    ours, other = plans["finite preview"], plans["case III"]
    pairs = [
        (np.asarray(getattr(ours, part)), np.asarray(getattr(other, part))) for part in ("F", "f")
    ]
    return {
        "nominal": nominal,
        "largest_gain_difference": max(
            float(np.max(np.abs(a - b)) / np.max(np.abs(b))) for a, b in pairs
        ),
    }


def _theorem_1(bench: Bench, directions: int) -> dict[str, Any]:
    """Largest spectral radius over the directions, per weight set, terminal and horizon; every unstable case by name."""
    degrees = np.arange(directions) * 180.0 / directions
    sets, unstable = [], []
    for alpha in THEOREM_ALPHAS:
        for beta in THEOREM_BETAS:
            for rho in THEOREM_RHOS:
                radii = radii_on_lines(
                    bench.model, LQWeights(alpha, beta, rho), np.deg2rad(degrees), THEOREM_HORIZON
                )
                weights = {"alpha": alpha, "beta": beta, "rho": rho}
                sets.append(
                    {
                        **weights,
                        **{
                            t: radii[:, i].max(axis=1).tolist()
                            for i, t in enumerate(bench.terminals)
                        },
                    }
                )
                for i, terminal in enumerate(bench.terminals):
                    for row in np.flatnonzero((radii[:, i] >= 1).any(axis=1)):
                        over = radii[row, i] >= 1
                        found = {
                            "unstable_directions": int(over.sum()),
                            "largest_radius": float(radii[row, i].max()),
                        }
                        unstable.append(
                            {"terminal": terminal, **weights, "preview": int(row) + 1, **found}
                        )
    return {
        "directions": directions,
        "longest": THEOREM_HORIZON,
        "sets": sets,
        "unstable": unstable,
    }
