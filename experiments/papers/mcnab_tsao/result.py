"""Result of the reproduction of McNab & Tsao."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim, Verdict

TERMINALS = ("output", "dare")  # C'QC, and H_s(Q_max)
PREVIEW = 10  # [samples] the paper's horizon, where it does not vary it


@dataclass(frozen=True)
class Case:
    """A controller of the study; rho is the paper's."""

    terminal: str
    alpha: float
    beta: float
    preview: int = PREVIEW


@dataclass(frozen=True)
class Member:
    """A machine: factors on its two inputs, and an input delay [samples].

    The controller knows neither.
    """

    gain_x: float
    gain_y: float
    delay: int


@dataclass(frozen=True)
class MachineRun:
    """One run on one machine; no errors where it diverges. RMS over the scored lap."""

    spectral_radius: float  # largest of the frozen loops
    diverged: bool
    te_um: float | None  # tracking error
    ce_um: float | None  # contour error
    projected_um: float | None  # contour error by the paper's eq. 3
    control: float | None
    increment: float | None

    @property
    def stable(self) -> bool:
        """Whether all frozen loops are."""
        return self.spectral_radius < 1


@dataclass(frozen=True)
class CaseRun:
    """One controller on the whole family, the nominal machine first."""

    terminal: str
    alpha: float
    beta: float
    preview: int
    machines: tuple[MachineRun, ...]

    @property
    def case(self) -> Case:
        """The controller."""
        return Case(self.terminal, self.alpha, self.beta, self.preview)


@dataclass(frozen=True)
class Grid:
    """Weights of the study."""

    alpha: tuple[float, ...]
    beta: tuple[float, ...]
    rho: float
    too_high_alpha: float  # beyond the paper's, for the U-shape

    @property
    def all_alphas(self) -> list[float]:
        """Alphas of the study, the one beyond the paper's last."""
        return [*self.alpha, self.too_high_alpha]


@dataclass(frozen=True)
class Points:
    """Samples of Fig. 2 [m], axes (sample, axis); outputs by beta."""

    desired_m: Float[np.ndarray, "S 2"]
    output_m: dict[str, Float[np.ndarray, "S 2"]]


@dataclass(frozen=True)
class FinitePreview:
    """Tomizuka & Whitney's controller beside case III, with and without the Appendix."""

    nominal: dict[str, MachineRun]
    largest_gain_difference: float  # relative


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
class Theorem1:
    """Loops on straight lines: every set of weights, terminal, direction and horizon."""

    directions: int
    longest: int  # horizon
    sets: tuple[RadiiOnLines, ...]
    unstable: tuple[UnstableLoop, ...]


@dataclass(frozen=True)
class Compared:
    """An error of the paper and ours [um]."""

    paper: float
    ours: float
    ratio: float


@dataclass(frozen=True)
class Table1Row:
    """Row of Table 1: measured on the machine, and ours."""

    case: str
    terminal: str
    alpha: float
    beta: float
    te_um: Compared
    ce_um: Compared
    verdict: Verdict


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    weights: Grid
    family: tuple[Member, ...]
    runs: tuple[CaseRun, ...]  # on the circle
    points: Points
    line: tuple[CaseRun, ...]
    finite_preview: FinitePreview
    theorem_1: Theorem1
    table_1: tuple[Table1Row, ...] = ()
    claims: tuple[Claim, ...] = ()

    def run_of(self, case: Case) -> CaseRun:
        """Run of one controller on the circle."""
        return next(run for run in self.runs if run.case == case)

    def nominal(self, case: Case) -> MachineRun:
        """Run of one controller on the circle, on the nominal machine."""
        return self.run_of(case).machines[0]
