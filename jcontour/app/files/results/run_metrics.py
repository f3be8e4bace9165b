"""Parts that the results of several commands have: metrics of a run, the machine, a contour."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from jcontour.app.files.results.stored import stored_as


@dataclass(frozen=True)
class RunMetrics:
    """Metrics of one run in SI units, as `jcontour.simulation.metrics.Metrics` names them."""

    rms_contour_error: float
    peak_contour_error: float
    rms_projected_error: float
    peak_projected_error: float
    rms_tracking_error: float
    peak_tracking_error: float
    rms_control: float
    peak_control: float
    rms_increment: float
    peak_increment: float
    duration: float
    diverged: bool

    @classmethod
    def of(cls, metrics: Any, pick: Callable[[np.ndarray], Any]) -> "RunMetrics":
        """One number of every metric: `pick` chooses it from an array of runs."""
        return cls(
            **{one.name: pick(np.asarray(getattr(metrics, one.name))) for one in fields(cls)}
        )


@dataclass(frozen=True)
class FamilyMetrics:
    """Metrics of the nominal plant, and the worst of the family metric by metric."""

    nominal: RunMetrics
    worst: RunMetrics


@dataclass(frozen=True)
class MachineSummary:
    """Machine in tables and figures.

    Attributes:
        nonsmooth_effects: what the simulated machine has and the one that is tuned on has not.
    """

    name: str
    control_unit: str
    axes: tuple[str, ...]
    nonsmooth_effects: str = stored_as("truth")


@dataclass(frozen=True)
class ContourRead:
    """Summary of a contour as it was read, SI units.

    Attributes:
        pieces: lines, arcs and polynomials of the path; moves of a program.
        length: of the path, rapid moves included [m].
        duration: of the whole run, all laps [s]; of a planned motion, its cycle time.
        low, high: corners of the box around the contour [m], one number per axis.
        ignored: words of the program that mean nothing for the path.
        doubts: what of the program may be meant otherwise.
        stops: where and why the program stops, in words.
        rapid_length: of the rapid moves [m].
        way: how far the tool goes along the path, more than once around it for several laps [m];
            None where that is the path.
        entry: of that way, what is behind the tool when scoring begins, at constant feed [m].
    """

    pieces: int
    length: float
    duration: float | None
    low: tuple[float, ...]
    high: tuple[float, ...]
    ignored: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    stops: str = ""
    rapid_length: float = 0.0
    way: float | None = None
    entry: float = 0.0

    @property
    def laps(self) -> float:
        """How often the tool goes around the path; 1 where it goes along it once, or a part."""
        return 1.0 if self.way is None else max(1.0, self.way / self.length)


@dataclass(frozen=True)
class MotionSummary:
    """Summary of a jerk-limited motion, SI units.

    Attributes:
        cycle_time: [s], rests included.
        stops: on the way.
        deviation: bound of the distance of its path from the contour [m].
        shares: of the cycle time under the feed, the speed, the acceleration and the jerk of an
            axis, and the tolerance of corners; and at rest. Together they are 1.
        jerk_limit, peak_jerk, peak_acceleration: one number per axis.
        gap: about the time that the planner left to gain [s].
        dwell: time that it rests, in dwells and while Z moves alone [s].
    """

    cycle_time: float
    stops: int
    deviation: float
    shares: dict[str, float]
    jerk_limit: tuple[float, ...]
    peak_jerk: tuple[float, ...]
    peak_acceleration: tuple[float, ...]
    gap: float = 0.0
    dwell: float = 0.0


@dataclass(frozen=True)
class PeakPlace:
    """Where the largest error of a contour is, over the whole family of plants.

    Attributes:
        plant: of the family.
        error: its size [m].
        time: from the start of the run [s].
        position: of the reference [m], one number per axis.
        line: of the program; None where there is no program.
    """

    plant: str
    error: float
    time: float
    position: tuple[float, ...]
    line: int | None = None
