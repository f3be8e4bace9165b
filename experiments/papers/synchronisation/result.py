"""Result of the reproduction of Tomizuka, Hu, Chiu & Kamano."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim

CONTINUOUS = 0.0  # sample period [ms] that stands for continuous time


@dataclass(frozen=True)
class Row:
    """Response to the step of load on axis 2; speeds per unit.

    Attributes:
        plant: name of the axes.
        period_ms: sample period; zero is continuous time.
        beta: coupling.
        peak_sync: largest difference of the two errors.
        iae_sync: integral of its magnitude [s].
        peak_e1: largest error of the axis without load.
        peak_e2: largest error of the axis with load.
        final_sync: difference at the end.
        turns: how often the difference goes through zero, above a thousandth of its peak.
        diverged: whether a speed passed a million.
    """

    plant: str
    period_ms: float
    beta: float
    peak_sync: float
    iae_sync: float
    peak_e1: float
    peak_e2: float
    final_sync: float
    turns: int
    diverged: bool


@dataclass(frozen=True)
class Bounds:
    """Bounds on beta of one loop.

    Attributes:
        plant: name of the axes.
        period_ms: sample period.
        adaptation: K of (18).
        continuous: largest beta with (9) positive definite; None where any is.
        proven: smallest beta at which (17) is no longer strictly positive real.
        exact: smallest beta at which the loop is no longer stable.
    """

    plant: str
    period_ms: float
    adaptation: float
    continuous: float | None
    proven: float
    exact: float


@dataclass(frozen=True)
class Curve:
    """Errors of both axes over time."""

    plant: str
    period_ms: float
    beta: float
    time_s: Float[np.ndarray, " T"]
    e1: Float[np.ndarray, " T"]
    e2: Float[np.ndarray, " T"]

    @property
    def apart(self) -> Float[np.ndarray, " T"]:
        """Synchronisation error e_1 - e_2."""
        return self.e1 - self.e2


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    rows: tuple[Row, ...]
    bounds: tuple[Bounds, ...]
    curves: tuple[Curve, ...]
    claims: tuple[Claim, ...] = ()

    def row(self, plant: str, period_ms: float, beta: float) -> Row:
        """The run of this plant, period and coupling."""
        wanted = (plant, period_ms, beta)
        return next(one for one in self.rows if (one.plant, one.period_ms, one.beta) == wanted)

    def column(self, plant: str, period_ms: float) -> list[Row]:
        """Runs of this plant and period, by coupling."""
        found = [one for one in self.rows if (one.plant, one.period_ms) == (plant, period_ms)]
        return sorted(found, key=lambda one: one.beta)

    def bound(self, plant: str, period_ms: float) -> Bounds:
        """Bounds of this plant and period."""
        wanted = (plant, period_ms)
        return next(one for one in self.bounds if (one.plant, one.period_ms) == wanted)

    def curve(self, plant: str, period_ms: float, beta: float) -> Curve:
        """Errors of this plant, period and coupling."""
        wanted = (plant, period_ms, beta)
        return next(one for one in self.curves if (one.plant, one.period_ms, one.beta) == wanted)
