"""Result of the reproduction of Yuan's chapter 5."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.speed.gantry_engines import EngineRate
from experiments.papers.verdicts import Claim


@dataclass(frozen=True)
class Response:
    """Fig. 5.6: frequency response from the current i_1 to the speed of its drive.

    Attributes:
        head_m: position of the head on the beam [m].
        coupling: whether the terms with M_e x_h are kept; (5.12) as printed has none.
        antiresonance_hz: of the zeros [Hz].
        resonance_hz: of the poles [Hz].
        frequency_hz: axis of the two curves [Hz].
        gain_db: relative to 1 m/s per ampere [dB].
        phase_deg: without jumps [deg].
    """

    head_m: float
    coupling: bool
    antiresonance_hz: float
    resonance_hz: float
    frequency_hz: Float[np.ndarray, " F"]
    gain_db: Float[np.ndarray, " F"]
    phase_deg: Float[np.ndarray, " F"]


@dataclass(frozen=True)
class PathRun:
    """The gantry along Fig. 5.11; axes (time, component), SI units."""

    time_s: Float[np.ndarray, " T"]
    twist_rad: Float[np.ndarray, " T"]
    tool_m: Float[np.ndarray, "T 2"]
    wanted_m: Float[np.ndarray, "T 2"]
    contour_error_m: Float[np.ndarray, " T"]
    control_a: Float[np.ndarray, "T 3"]
    peak_twist_rad: float
    peak_contour_error_m: float
    rms_contour_error_m: float
    diverged: bool


@dataclass(frozen=True)
class EmulatedRun:
    """Section 5.6.4: errors along X and Y and from the contour, for one kind of head.

    Attributes:
        name: "gantry", or the condition of the bench that stands for its head.
        distance_m: largest distance of the tool from that of the gantry [m].
        twist_damping: what damps the twist without a controller [N m s/rad].
        peak_load_a: largest current of the load motor [A].
        peak_remainder_m_per_s: largest F_Nx of (5.50), defined for a bench one sample late [m/s].
    """

    name: str
    peak_x_error_m: float
    peak_y_error_m: float
    peak_contour_error_m: float
    rms_contour_error_m: float
    peak_twist_rad: float
    twist_rad: Float[np.ndarray, " T"]
    diverged: bool
    contour_error_m: Float[np.ndarray, " T"]
    distance_m: float
    twist_damping: float | None = None  # of a bench
    peak_load_a: float | None = None
    peak_remainder_m_per_s: float | None = None


@dataclass(frozen=True)
class Emulated:
    """Section 5.6: the gantry, and benches in its head's place; damping in N m s/rad."""

    time_s: Float[np.ndarray, " T"]
    added_damping: float  # of the twist, by the drives
    rows: tuple[EmulatedRun, ...]
    viscous_damping: float  # of the twist, by friction: 2 b_y L^2

    def row(self, name: str) -> EmulatedRun:
        """Run with this kind of head."""
        return next(row for row in self.rows if row.name == name)


@dataclass(frozen=True)
class Identified:
    """Section 5.2.2: a quantity of the machine, and what the identification finds."""

    name: str
    true: float
    found: float
    interval: Sequence[float]  # 95 %: from, to


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    responses: tuple[Response, ...]
    path: PathRun
    emulated: Emulated
    identified: tuple[Identified, ...]
    engines: Sequence[EngineRate]  # our model first
    claims: tuple[Claim, ...] = ()

    def response(self, head: float, coupling: bool) -> Response:
        """Response for a position of the head [m]."""
        wanted = (head, coupling)
        return next(row for row in self.responses if (row.head_m, row.coupling) == wanted)
