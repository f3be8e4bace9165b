"""Result of the reproduction of Alter & Tsao."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim, Verdict


@dataclass(frozen=True)
class Line:
    """Line of Table 1, simulated: errors over one period of the trajectory [m]."""

    line: int
    order: int
    preview: int
    constraint: int
    l1_cost: float
    hinf_cost: float
    gap: float  # between the cost and the dual's bound
    max_error: float
    rms_error: float
    printed_max: str
    printed_rms: str
    measured_max: str  # on the authors' machine
    measured_rms: str
    max_verdict: Verdict
    rms_verdict: Verdict


@dataclass(frozen=True)
class Costs:
    """Row of Table 2."""

    order: int
    preview: int
    constraint: int
    value: float  # |M(b)|
    limit: float
    optimal: float  # 2 |M(b)| / (1 - b), Corollary 1
    by_program: float  # the same by linear programming
    attainable: float  # smaller where T and G share lambda = 1
    printed_limit: str
    printed_optimal: str


@dataclass(frozen=True)
class LoopRun:
    """One controller in the loop with the example drive, from rest, over its second period."""

    controller: str
    order: int
    preview: int
    constraint: int
    max_error: float  # [m]
    apart: float  # from the filter E_track [m]
    per_acceleration: float  # largest model following error over largest second difference
    slowest_pole: float  # smallest modulus in lambda: above one is stable


@dataclass(frozen=True)
class Perturbed:
    """Cost of the suboptimal filter with the unit-circle zero moved by eps."""

    eps: float
    l1: float
    hinf: float


@dataclass(frozen=True)
class Line30:
    """Table 3, line 30: the eps that its printed numbers imply, and what other filters give."""

    eps_from_max: float
    eps_from_rms: float
    limit_max: float  # eps -> 0 [m]
    limit_rms: float
    optimal_max: float  # of the l1-optimal FIR filter [m]


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    zero_interval: tuple[float, float]  # of b, for which lines 3 to 11 round to the print
    bandwidths_hz: dict[str, float]
    zpetc_apart: float  # from line 28
    trajectory: Float[np.ndarray, " T"]  # one period [m]
    errors: dict[str, Float[np.ndarray, " T"]]  # of Figs 3 and 4 [m]
    table_1: tuple[Line, ...]
    table_2: tuple[Costs, ...]
    line_30: Line30
    loops: tuple[LoopRun, ...]
    perturbed: tuple[Perturbed, ...]
    claims: tuple[Claim, ...] = ()
