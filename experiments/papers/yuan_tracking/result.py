"""Result of the reproduction of Yuan's chapter 3."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim, Verdict

TASKS = ("A", "B")  # point to point, to and fro along a cosine
KEPT_PERIOD = 5e-3  # [s] between the samples of a signal: a fourteenth of the link's period


@dataclass(frozen=True)
class Columns:
    """Columns of Tables 3.1 and 3.2: errors and deformation [mm], mean current [A]."""

    em_max: float  # motor
    em_mean: float
    ee_max: float  # end effector
    ee_mean: float
    def_max: float  # motor against end effector
    u_mean: float


@dataclass(frozen=True)
class TaskMetrics(Columns):
    """Columns of the thesis, and RMS and peak of the current [A]."""

    u_rms: float
    u_max: float


@dataclass(frozen=True)
class TimedColumns(Columns):
    """Columns of the thesis, and our computing time per sample [us]."""

    time_us: float


@dataclass(frozen=True)
class TableRow:
    """Row of Table 3.1 or 3.2: the test bench, and our simulation of its model."""

    task: str
    name: str
    verdict: Verdict
    paper: Columns
    paper_time_ms: float
    ours: dict[str, TimedColumns]  # by controller


@dataclass(frozen=True)
class FamilyRow:
    """One task on one machine of the family; no numbers where the run diverges."""

    task: str
    plant: str
    diverged: bool
    ee_mean: float | None  # [mm]
    u_rms: float | None  # [A]


@dataclass(frozen=True)
class RankingRow:
    """A controller with its first gains ("start") or with tuned ones ("tuned")."""

    controller: str
    gains: str
    weights: dict[str, Any]
    A: TaskMetrics
    B: TaskMetrics
    family: tuple[FamilyRow, ...]  # of tuned controllers, and of the one they are compared with
    time_us: float  # of computing per sample

    def on(self, task: str) -> TaskMetrics:
        """Metrics of one task."""
        return {"A": self.A, "B": self.B}[task]

    @property
    def error(self) -> float:
        """Mean error of the end effector, both tasks together [mm]."""
        return self.A.ee_mean + self.B.ee_mean


@dataclass(frozen=True)
class Signals:
    """Motor, end effector and reference [m], and current [A], of one run."""

    motor: Float[np.ndarray, " T"]
    tool: Float[np.ndarray, " T"]
    wanted: Float[np.ndarray, " T"]
    current: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class GapRow:
    """Relative gap of the smooth twin in RMS end-effector error, at one sharpness [s/m]."""

    sharpness: float
    A: float
    B: float

    def on(self, task: str) -> float:
        """Gap on one task."""
        return {"A": self.A, "B": self.B}[task]


@dataclass(frozen=True)
class Result:
    """All that is found."""

    source: str
    settings: dict[str, Any]
    ranking: tuple[RankingRow, ...]
    signals: dict[str, dict[str, Signals]]  # by controller and task, every `KEPT_PERIOD`
    gap: tuple[GapRow, ...]  # sharpness ascending
    tables: tuple[TableRow, ...] = ()
    claims: tuple[Claim, ...] = ()
