"""Result of the reproduction of Yuan, chapter 4."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim

UNKNOWN, PREVIEWED = "unknown", "previewed"  # what the controller knows of the reference


@dataclass(frozen=True)
class CertificateRow:
    """Least tolerance that any controller at all needs.

    Attributes:
        disturbance_mm_s: largest w.
        speed_limit: of motor and end effector [m/s].
        bound_mm: proven by the multipliers of the linear program.
    """

    disturbance_mm_s: float
    speed_limit: float
    bound_mm: float


@dataclass(frozen=True)
class LeastRow:
    """Least tolerance of finite responses; None where none respects the limits.

    Attributes:
        reference: what is known of it.
        length: samples N.
        tolerance_mm: the least.
        limiting: limits that keep it from being smaller, or that none respects.
    """

    reference: str
    length: int
    tolerance_mm: float | None
    limiting: tuple[str, ...]


@dataclass(frozen=True)
class LoopRow:
    """Run of the bounded MPC under disturbances in their box.

    Attributes:
        reference: what is known of it.
        length: samples N of the plan.
        promised_mm: tolerance.
        largest_mm: largest tracking error of the end effector.
        largest_current: [A].
        largest_speed: of motor and end effector, in error coordinates if the reference is unknown
            [m/s].
        speed_limit: for it [m/s].
        samples: how many were simulated, every QP solved.
        error_mm: tracking error (T,).
    """

    reference: str
    length: int
    promised_mm: float
    largest_mm: float
    largest_current: float
    largest_speed: float
    speed_limit: float
    samples: int
    error_mm: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class Result:
    """Everything that is computed.

    Attributes:
        observer_radius: spectral radius of the printed observer on the printed model.
    """

    source: str
    settings: dict[str, Any]
    observer_radius: float
    certificates: tuple[CertificateRow, ...]
    least: tuple[LeastRow, ...]
    loops: tuple[LoopRow, ...]
    claims: tuple[Claim, ...] = ()
