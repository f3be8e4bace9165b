"""McNab & Tsao 2000: receding-horizon LQ contouring on an X-Y table, every table, figure, theorem.

Only their simulated figures can be reproduced. Table 1 and Figs 3, 5, 7, 8 were measured on the
machine: our simulation is shown beside them and not fitted to them. At high weights the machine
behaves otherwise than their simulation. We look for the reason in a family of machines with an
input delay and input gains that the controller does not know.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from experiments.papers.mcnab_tsao.claims import (
    FIGURE_2_ALPHA,
    FIGURE_9,
    FIGURE_10,
    PublishedRow,
    claims,
    table_1,
)
from experiments.papers.mcnab_tsao.figures import draw
from experiments.papers.mcnab_tsao.result import (
    PREVIEW,
    TERMINALS,
    Case,
    CaseRun,
    FinitePreview,
    Grid,
    MachineRun,
    Points,
    RadiiOnLines,
    Result,
    Theorem1,
    UnstableLoop,
)
from experiments.papers.mcnab_tsao.runs import (
    LONGEST,
    RHO,
    FamilyRun,
    Setup,
    family,
    radii_on_lines,
)
from experiments.papers.mcnab_tsao.tables import show
from jcontour.controllers.lq.contouring_lq import LQWeights

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "R. J. McNab, T.-C. Tsao: Receding Time Horizon Linear Quadratic Optimal Control for "
    "Multi-Axis Contour Tracking Motion Control. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 122 (2000)"
)
PUBLISHED = (
    PublishedRow("I", "output", 8.0, 0.0, 3.35, 3.07),
    PublishedRow("II", "output", 1.2, 20.0, 43.07, 1.07),
    PublishedRow("III", "dare", 3.0, 0.0, 4.10, 3.78),
    PublishedRow("IV", "dare", 0.25, 15.0, 6.55, 1.70),
    PublishedRow("finite preview", "dare", 3.0, 0.0, 4.10, 3.78),
)
# the paper's weights and what lies between; 20 is an alpha beyond the paper's, for the U-shape
WEIGHTS = Grid((0.25, 0.5, 1.2, 3.0, 4.0, 8.0), (0.0, 1.0, 5.0, 15.0, 20.0), RHO, 20.0)
LINE_ALPHA, LINE_BETAS = 3.0, (0.0, 1.0, 5.0, 20.0)  # 3/0 -> 3/5
LINE_SCALES = (1.0, 10.0)  # and the same at ten times the weights
POINTS = slice(591, 602)  # samples near the circle's upper left, in the scored lap
THEOREM_ALPHAS = (0.25, 3.0, 8.0)
THEOREM_BETAS = (0.0, 5.0, 15.0, 20.0)
THEOREM_RHOS = (RHO, RHO * 1e-2, RHO * 1e-4)
THEOREM_HORIZON = 50
# over half a turn: the weight is that of the opposite direction
THEOREM_DIRECTIONS, QUICK_DIRECTIONS = 72, 18

Progress = Callable[[float, str], None]  # (part done, what is being done)


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce mcnab-tsao`."""

    quick: bool = False
    """Finish within a minute: Theorem 1 in 18 directions in place of 72, all else as ever."""
    delay: int = 2
    """Largest input delay [samples] of the machines behind Figs 3, 5, 7 and 8."""
    gain_error: float = 0.1
    """Input gain error of the family: one axis stronger by this part and the other weaker."""

    def __post_init__(self):
        if self.delay < 1:
            raise ValueError(f"delay: needs at least one sample, received {self.delay}")
        if not 0 <= self.gain_error < 1:
            raise ValueError(f"gain_error: needs a part from 0 up to 1, received {self.gain_error}")


def run(settings: Settings, folder: Path, progress: Progress | None = None) -> Result:
    """Simulate everything; nothing is written to the folder."""
    tell = progress or (lambda part, doing: None)
    tell(0.0, "compiling")
    setup = Setup(family(settings.gain_error, settings.delay))
    runs, points = _on_circle(setup, tell)
    tell(0.6, "line")
    cases = [
        Case(terminal, scale * LINE_ALPHA, scale * beta)
        for terminal, scale, beta in product(TERMINALS, LINE_SCALES, LINE_BETAS)
    ]
    line = [_row(case, setup.run(setup.plan(case, setup.line), setup.line)) for case in cases]
    tell(0.65, "finite preview")
    finite_preview = _finite_preview(setup)
    tell(0.7, "Theorem 1")
    directions = QUICK_DIRECTIONS if settings.quick else THEOREM_DIRECTIONS
    found = Result(
        source=SOURCE,
        settings=asdict(settings),
        weights=WEIGHTS,
        family=setup.family,
        runs=tuple(runs),
        points=points,
        line=tuple(line),
        finite_preview=finite_preview,
        theorem_1=_theorem_1(setup, directions),
    )
    found = replace(found, table_1=table_1(PUBLISHED, found))
    found = replace(found, claims=claims(found))
    tell(1.0, "done")
    return found


def _on_circle(setup: Setup, tell: Progress) -> tuple[list[CaseRun], Points]:
    """Every case on the circle, and the points of Fig. 2."""
    cases, runs, outputs = _cases(), [], {}
    for k, case in enumerate(cases):
        name = f"{case.terminal} terminal, {case.alpha:g}/{case.beta:g}, preview {case.preview}"
        tell(0.1 + 0.5 * k / len(cases), f"circle, {name}")
        found = setup.run(setup.plan(case, setup.circle), setup.circle)
        runs.append(_row(case, found))
        if (case.terminal, case.alpha, case.preview) == ("output", FIGURE_2_ALPHA, PREVIEW):
            outputs[f"{case.beta:g}"] = found.output[0, POINTS]
    return runs, Points(np.asarray(setup.circle.position[POINTS]), outputs)


def _cases() -> list[Case]:
    """Grid of weights, and the preview lengths of Figs 9 and 10; N_p = 10 is in both."""
    grid = [Case(*case) for case in product(TERMINALS, WEIGHTS.alpha, WEIGHTS.beta)]
    grid += [Case(terminal, WEIGHTS.too_high_alpha, 0.0) for terminal in TERMINALS]
    scan = [
        Case(terminal, *weights, preview)
        for weights, terminal, preview in product(
            (FIGURE_9, FIGURE_10), TERMINALS, range(1, LONGEST + 1)
        )
    ]
    return list(dict.fromkeys(grid + scan))


def _row(case: Case, found: FamilyRun) -> CaseRun:
    machines = [_machine(found, i) for i in range(len(found.spectral_radius))]
    return CaseRun(case.terminal, case.alpha, case.beta, case.preview, tuple(machines))


def _machine(found: FamilyRun, i: int) -> MachineRun:
    """Errors on one member of the family."""
    metrics, radius = found.metrics, float(found.spectral_radius[i])
    if metrics.diverged[i]:
        return MachineRun(radius, True, None, None, None, None, None)
    return MachineRun(
        spectral_radius=radius,
        diverged=False,
        te_um=1e6 * float(metrics.rms_tracking_error[i]),
        ce_um=1e6 * float(metrics.rms_contour_error[i]),
        projected_um=1e6 * float(metrics.rms_projected_error[i]),
        control=float(metrics.rms_control[i]),
        increment=float(metrics.rms_increment[i]),
    )


def _finite_preview(setup: Setup) -> FinitePreview:
    """Tomizuka & Whitney's controller beside case III, and case III without the Appendix."""
    case_iii = Case("dare", 3.0, 0.0)
    plans = {
        "finite preview": setup.plan_finite_preview(case_iii.alpha, setup.circle),
        "case III": setup.plan(case_iii, setup.circle),
        "case III, path held": setup.plan_holding(case_iii, setup.circle),
    }
    runs = {name: setup.run(plan, setup.circle) for name, plan in plans.items()}
    nominal = {name: _machine(run, 0) for name, run in runs.items()}
    ours, theirs = plans["finite preview"], plans["case III"]
    differences = [_difference(ours.F, theirs.F), _difference(ours.f, theirs.f)]
    return FinitePreview(nominal, max(differences))


def _difference(ours, theirs) -> float:
    """Largest difference over the largest entry."""
    a, b = np.asarray(ours), np.asarray(theirs)
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def _theorem_1(setup: Setup, directions: int) -> Theorem1:
    """Largest spectral radii over the directions; every unstable loop by name."""
    angles = np.deg2rad(np.arange(directions) * 180.0 / directions)
    sets: list[RadiiOnLines] = []
    unstable: list[UnstableLoop] = []
    for weights in product(THEOREM_ALPHAS, THEOREM_BETAS, THEOREM_RHOS):
        radii = radii_on_lines(setup.model, LQWeights(*weights), angles, THEOREM_HORIZON)
        output, dare = (radii[:, i].max(axis=1).tolist() for i in range(len(TERMINALS)))
        sets.append(RadiiOnLines(*weights, output, dare))
        for i, terminal in enumerate(TERMINALS):
            unstable += _unstable(terminal, weights, radii[:, i])
    return Theorem1(directions, THEOREM_HORIZON, tuple(sets), tuple(unstable))


def _unstable(
    terminal: str, weights: tuple[float, float, float], radii: np.ndarray
) -> list[UnstableLoop]:
    """Horizons at which some direction is unstable; `radii` has axes (horizon, direction)."""
    found = []
    for row in np.flatnonzero((radii >= 1).any(axis=1)):
        count, largest = int((radii[row] >= 1).sum()), float(radii[row].max())
        found.append(UnstableLoop(terminal, *weights, int(row) + 1, count, largest))
    return found
