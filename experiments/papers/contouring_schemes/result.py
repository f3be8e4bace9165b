"""Result of the comparison of contouring schemes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.papers.verdicts import Claim


@dataclass(frozen=True)
class Row:
    """One scheme on one true machine along one contour.

    Errors are RMS over the run, in um; current and increment are RMS, in A.
    """

    scheme: str
    loops: str
    contour: str
    training: bool  # whether the tuner saw the contour
    plant: str
    contour_um: float
    peak_um: float
    tracking_um: float
    current_a: float
    increment_a: float
    diverged: bool
    motor_um: float  # contour error at the motors, where the schemes measure
    time_s: float  # arrival; not finite when the tool does not arrive


@dataclass(frozen=True)
class TunedScheme:
    """Gains of one scheme, and how its tuning went."""

    scheme: str
    loops: str
    cascade: dict[str, list[float]]
    gains: list[float]  # of the scheme itself
    feasible: bool
    diverged_points: int
    smooth_um: float  # mean RMS contour error on the smooth twin
    best_um: Sequence[float]  # best feasible objective after every evaluation, the cascade's first


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    tuned_on: tuple[str, ...]
    evaluations: int  # of one descent
    limits: dict[str, float]
    tuning: tuple[TunedScheme, ...]
    rows: tuple[Row, ...]
    claims: tuple[Claim, ...] = ()

    @property
    def schemes(self) -> list[str]:
        """Tuned schemes, in their order."""
        return list(dict.fromkeys(row.scheme for row in self.tuning))

    @property
    def loops(self) -> list[str]:
        """Kinds of loops."""
        return list(dict.fromkeys(row.loops for row in self.rows))

    @property
    def plants(self) -> list[str]:
        """Machines."""
        return list(dict.fromkeys(row.plant for row in self.rows))

    def contours(self, training: bool | None = None) -> list[str]:
        """All contours, or those that the tuner has or has not seen."""
        rows = [row for row in self.rows if training is None or row.training is training]
        return list(dict.fromkeys(row.contour for row in rows))

    def mean(
        self,
        scheme: str,
        loops: str,
        plant: str,
        *,
        training: bool | None = None,
        contour: str | None = None,
        column: str = "contour_um",
    ) -> float:
        """Mean of a column over the contours of this kind, or over one contour.

        Infinite when a run diverged or has no such number.
        """
        rows = [
            row
            for row in self.rows
            if (row.scheme, row.loops, row.plant) == (scheme, loops, plant)
            and (training is None or row.training is training)
            and (contour is None or row.contour == contour)
        ]
        values = np.array([getattr(row, column) for row in rows])
        if any(row.diverged for row in rows) or not np.isfinite(values).all():
            return float("inf")
        return float(np.mean(values))
