"""Result of the reproduction of Lam, Manzie & Good."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim


@dataclass(frozen=True)
class Lobes:
    """Contour of all runs."""

    length_mm: float
    max_radius_mm: float  # from the centre
    points_mm: Float[np.ndarray, "points 2"]


@dataclass(frozen=True)
class Trace:
    """Signals of one run of MPCC up to the end of the path, Figs 8 to 11; axes (time, axis)."""

    q_theta: float
    theta_mm: Float[np.ndarray, " T"]  # path parameter: 0 at the end, as in the paper
    tool_mm: Float[np.ndarray, "T 2"]
    foot_mm: Float[np.ndarray, "T 2"]  # nearest point of the path
    control_a: Float[np.ndarray, "T 2"]
    speed_mm_s: Float[np.ndarray, " T"]
    contour_error_um: Float[np.ndarray, " T"]
    curvature_per_mm: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class Point:
    """One run in Fig. 13: how long it takes, and how far it leaves the path."""

    controller: str
    plant: str
    setting: str
    finished: bool
    time_s: float  # not finite when the tool does not arrive
    rms_um: float
    peak_um: float
    rms_percent: float  # of the largest radius
    limited_percent: float  # of the steps have a limit active


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    plants: tuple[str, ...]
    path: Lobes
    traces: tuple[Trace, ...]  # q_theta ascending
    trade_off: tuple[Point, ...]
    claims: tuple[Claim, ...] = ()
