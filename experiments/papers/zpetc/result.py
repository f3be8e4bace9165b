"""Result of the reproduction of Smith & Lee."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim


@dataclass(frozen=True)
class Model:
    """Discrete model: gain, zero (-z of 1 + z / z) and poles, in print and ours."""

    item: str
    pole_rad_s: float  # of the servo that it is made from
    gain: float
    zero: float
    poles: tuple[float, float]
    printed_gain: str
    printed_zero: str
    printed_poles: tuple[str, str]


@dataclass(frozen=True)
class Prefilter:
    """Coefficients of (8), and what they are made from."""

    item: str
    taps: tuple[float, ...]
    printed: tuple[str, ...]


@dataclass(frozen=True)
class IntegralRun:
    """Zero phase tracking of one leg with an integrator, counts of 43 um."""

    truth: str
    integral_time: float | None  # [s]; None without
    mean_um: float
    peak_um: float


@dataclass(frozen=True)
class AdaptiveRun:
    """Adaptive zero phase tracking of one leg, counts of 43 um."""

    truth: str
    theta: tuple[float, float]  # first a_1 and b_0
    trace: float
    rule: str  # of the forgetting factor: ours, as printed, or none
    mean_um: float
    peak_um: float
    second_half_um: float
    final_theta: tuple[float, float]
    fitted_theta: tuple[float, float]  # of the servo's loop, by least squares along the path
    final_trace: float


@dataclass(frozen=True)
class GainError:
    """Gain and phase that zero phase tracking leaves, over frequency."""

    hertz: Float[np.ndarray, " f"]
    error: Float[np.ndarray, " f"]
    phase: Float[np.ndarray, " f"]  # of y / y_d [rad]


@dataclass(frozen=True)
class Units:
    """Gain and pole of (1) from Table 1, with one of the two amplifier gains."""

    source: str
    amperes_per_volt: float
    gain_inch: float  # inch / (s^2 V)
    pole: float  # [rad/s]


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    models: tuple[Model, ...]
    prefilters: tuple[Prefilter, ...]
    slow_pole: float  # of the printed loop [rad/s]
    corrected_5: float  # difference between (5), corrected, and a simulation at 3 Hz
    printed_5: float  # the same as printed
    units: tuple[Units, ...]
    gain_error: GainError
    path_mm: Float[np.ndarray, "T legs"]  # lengths of the legs from the start, every 3 ms
    errors_um: dict[str, Float[np.ndarray, " T"]]  # of drawn runs
    integral: tuple[IntegralRun, ...]
    adaptive: tuple[AdaptiveRun, ...]
    claims: tuple[Claim, ...] = ()
