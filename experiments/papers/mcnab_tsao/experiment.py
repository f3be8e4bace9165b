"""McNab & Tsao 2000: receding-horizon LQ contouring on an X-Y table, every table, figure, theorem.

Only their simulated figures can be reproduced. Table 1 and Figs 3, 5, 7, 8 were measured on the
machine: our simulation is shown beside them and not fitted to them. At high weights the machine
behaves otherwise than their simulation. We look for the reason in a family of machines with an
input delay and input gains that the controller does not know.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from experiments.papers.mcnab_tsao.runs import (
    LONGEST,
    RHO,
    TERMINALS,
    Case,
    FamilyRun,
    Member,
    Setup,
    family,
    radii_on_lines,
)
from jcontour.controllers.lq.contouring_lq import LQWeights

SOURCE = (
    "R. J. McNab, T.-C. Tsao: Receding Time Horizon Linear Quadratic Optimal Control for "
    "Multi-Axis Contour Tracking Motion Control. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 122 (2000)"
)
# the paper's weights and what lies between
ALPHAS, BETAS = (0.25, 0.5, 1.2, 3.0, 4.0, 8.0), (0.0, 1.0, 5.0, 15.0, 20.0)
TOO_HIGH_ALPHA = 20.0  # beyond the paper's, for the U-shape
FIGURE_2_ALPHA = 1.2  # the largest at which the points of Fig. 2 can still be told apart
FIGURE_9, FIGURE_10 = (4.0, 0.0), (0.25, 15.0)  # the paper's alpha, beta
LINE_ALPHA, LINE_BETAS = 3.0, (0.0, 1.0, 5.0, 20.0)  # 3/0 -> 3/5
LINE_SCALES = (1.0, 10.0)  # and the same at ten times the weights
POINTS = slice(591, 602)  # samples near the circle's upper left, in the scored lap
THEOREM_ALPHAS = (0.25, 3.0, 8.0)
THEOREM_BETAS = (0.0, 5.0, 15.0, 20.0)
THEOREM_RHOS = (RHO, RHO * 1e-2, RHO * 1e-4)
THEOREM_HORIZON = 50
# over half a turn: the weight is that of the opposite direction
THEOREM_DIRECTIONS, QUICK_DIRECTIONS = 72, 18


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


@dataclass(frozen=True)
class MachineRun:
    """One run on one machine; errors are not finite where it diverges. RMS over the scored lap."""

    spectral_radius: float  # largest of the frozen loops
    diverged: bool
    te_um: float  # tracking error
    ce_um: float  # contour error
    projected_um: float  # contour error by the paper's eq. 3
    control: float
    increment: float

    @property
    def stable(self) -> bool:
        """Whether all frozen loops are."""
        return self.spectral_radius < 1


@dataclass(frozen=True)
class CaseRun:
    """One controller on the whole family, the nominal machine first."""

    case: Case
    machines: tuple[MachineRun, ...]


@dataclass(frozen=True)
class RadiiOnLines:
    """Largest spectral radius over all directions, horizon by horizon, for one set of weights."""

    alpha: float
    beta: float
    rho: float
    output: Sequence[float]
    dare: Sequence[float]


@dataclass(frozen=True)
class UnstableLoop:
    """Weights, terminal and horizon for which the loop is unstable in some direction."""

    terminal: str
    alpha: float
    beta: float
    rho: float
    preview: int
    unstable_directions: int
    largest_radius: float


@dataclass(frozen=True)
class Result:
    """Runs on the circle and the line, Fig. 2, finite preview, and Theorem 1."""

    family: tuple[Member, ...]
    circle: tuple[CaseRun, ...]
    line: tuple[CaseRun, ...]
    desired_m: Float[np.ndarray, "S 2"]  # samples of Fig. 2
    output_m: dict[str, Float[np.ndarray, "S 2"]]  # the same, by beta
    finite_preview: dict[str, MachineRun]  # beside case III, with and without the Appendix
    largest_gain_difference: float  # between the first two of them, relative
    directions: int  # of the straight lines
    sets: tuple[RadiiOnLines, ...]
    unstable: tuple[UnstableLoop, ...]

    def on_family(self, *case) -> tuple[MachineRun, ...]:
        """Runs of one controller on the circle: terminal, alpha, beta and maybe preview."""
        return next(run.machines for run in self.circle if run.case == Case(*case))

    def over_weights(self, terminal: str, error: str) -> Float[np.ndarray, "alphas betas"]:
        """One error on the nominal machine over the weight grid."""
        values = [
            getattr(self.on_family(terminal, *pair)[0], error) for pair in product(ALPHAS, BETAS)
        ]
        return np.reshape(values, (len(ALPHAS), len(BETAS)))

    def over_previews(
        self, terminal: str, weights: tuple[float, float], error: str
    ) -> dict[int, float]:
        """One error on the nominal machine by the preview length."""
        lengths = range(1, LONGEST + 1)
        return {n: getattr(self.on_family(terminal, *weights, n)[0], error) for n in lengths}


def run(settings: Settings) -> Result:
    """Simulate everything."""
    setup = Setup(family(settings.gain_error, settings.delay))
    circle, outputs = [], {}
    for case in _cases():
        found = setup.run(setup.plan(case, setup.circle), setup.circle)
        circle.append(CaseRun(case, _machines(found)))
        if case == Case("output", FIGURE_2_ALPHA, case.beta):
            outputs[f"{case.beta:g}"] = found.output[0, POINTS]
    line = []
    for terminal, scale, beta in product(TERMINALS, LINE_SCALES, LINE_BETAS):
        case = Case(terminal, scale * LINE_ALPHA, scale * beta)
        found = setup.run(setup.plan(case, setup.line), setup.line)
        line.append(CaseRun(case, _machines(found)))
    case_iii = Case("dare", 3.0, 0.0)
    plans = {
        "finite preview": setup.plan_finite_preview(case_iii.alpha, setup.circle),
        "case III": setup.plan(case_iii, setup.circle),
        "case III, path held": setup.plan_holding(case_iii, setup.circle),
    }
    ours, theirs, _ = plans.values()
    directions = QUICK_DIRECTIONS if settings.quick else THEOREM_DIRECTIONS
    sets, unstable = _theorem_1(setup, directions)
    return Result(
        family=setup.family,
        circle=tuple(circle),
        line=tuple(line),
        desired_m=np.asarray(setup.circle.position[POINTS]),
        output_m=outputs,
        finite_preview={
            name: _machines(setup.run(plan, setup.circle))[0] for name, plan in plans.items()
        },
        largest_gain_difference=max(_difference(ours.F, theirs.F), _difference(ours.f, theirs.f)),
        directions=directions,
        sets=tuple(sets),
        unstable=tuple(unstable),
    )


def _cases() -> list[Case]:
    """Grid of weights, and the preview lengths of Figs 9 and 10; N_p = 10 is in both."""
    grid = [Case(*case) for case in product(TERMINALS, ALPHAS, BETAS)]
    grid += [Case(terminal, TOO_HIGH_ALPHA, 0.0) for terminal in TERMINALS]
    scans = product((FIGURE_9, FIGURE_10), TERMINALS, range(1, LONGEST + 1))
    scan = [Case(terminal, *weights, preview) for weights, terminal, preview in scans]
    return list(dict.fromkeys(grid + scan))


def _machines(found: FamilyRun) -> tuple[MachineRun, ...]:
    """Errors [um] on every member of the family."""
    metrics, lost = found.metrics, np.asarray(found.metrics.diverged)
    columns = (
        1e6 * np.asarray(metrics.rms_tracking_error),
        1e6 * np.asarray(metrics.rms_contour_error),
        1e6 * np.asarray(metrics.rms_projected_error),
        np.asarray(metrics.rms_control),
        np.asarray(metrics.rms_increment),
    )
    rows = np.where(lost, np.inf, columns).T.tolist()
    radii = found.spectral_radius.tolist()
    return tuple(
        MachineRun(radius, bool(diverged), *row)
        for radius, diverged, row in zip(radii, lost, rows, strict=True)
    )


def _difference(ours, theirs) -> float:
    """Largest difference over the largest entry."""
    a, b = np.asarray(ours), np.asarray(theirs)
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def _theorem_1(setup: Setup, directions: int) -> tuple[list[RadiiOnLines], list[UnstableLoop]]:
    """Largest spectral radii over the directions; every unstable loop by name."""
    angles = np.deg2rad(np.arange(directions) * 180.0 / directions)
    sets: list[RadiiOnLines] = []
    unstable: list[UnstableLoop] = []
    for weights in product(THEOREM_ALPHAS, THEOREM_BETAS, THEOREM_RHOS):
        # axes (horizon, terminal, direction)
        radii = radii_on_lines(setup.model, LQWeights(*weights), angles, THEOREM_HORIZON)
        output, dare = radii.max(axis=2).T.tolist()
        sets.append(RadiiOnLines(*weights, output, dare))
        for i, terminal in enumerate(TERMINALS):
            for row in np.flatnonzero((radii[:, i] >= 1).any(axis=1)):
                count, largest = int((radii[row, i] >= 1).sum()), float(radii[row, i].max())
                unstable.append(UnstableLoop(terminal, *weights, int(row) + 1, count, largest))
    return sets, unstable
