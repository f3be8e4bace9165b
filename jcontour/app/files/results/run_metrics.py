"""Parts that the results of several commands have: metrics of a run, the machine, a contour."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

CONTROL, INCREMENT = "control", "increment"  # units that the machine names


class Metric(NamedTuple):
    """How a metric is shown; lengths in um."""

    words: str  # its name for people
    unit: str  # SI, or one of the control
    # in_tables, on_page: whether it is shown there
    in_tables: bool = False
    on_page: bool = False

    @property
    def factor(self) -> float:
        """From SI to what is shown."""
        return 1e6 if self.unit == "m" else 1.0

    @property
    def heading(self) -> str:
        """Heading of a column, in three lines."""
        lines = [*self.words.split(" "), ""][:3]
        return "\n".join(lines) + (" um" if self.unit == "m" else "")

    def si(self, control_unit: str) -> str:
        """Unit in SI, with the unit of the machine's control."""
        return {CONTROL: control_unit, INCREMENT: f"{control_unit} per sample"}.get(
            self.unit, self.unit
        )

    def shown(self, control_unit: str) -> str:
        """Unit that is shown."""
        return "um" if self.unit == "m" else self.si(control_unit)


def _shown(words: str, unit: str, **where: bool) -> Any:
    return field(default=float("nan"), metadata={Metric: Metric(words, unit, **where)})


@dataclass(frozen=True, kw_only=True)
class RunMetrics:
    """Metrics of one run in SI units, as `jcontour.simulation.metrics.Metrics` computes them.

    This is the list that limits, tables, the page and the files read. A stored run that is older
    than a metric has NaN there.
    """

    rms_contour_error: float = _shown("RMS contour error", "m", in_tables=True, on_page=True)
    peak_contour_error: float = _shown("peak contour error", "m", in_tables=True, on_page=True)
    rms_projected_error: float = _shown("RMS projected error", "m")
    peak_projected_error: float = _shown("peak projected error", "m")
    rms_tracking_error: float = _shown("RMS tracking error", "m", in_tables=True, on_page=True)
    peak_tracking_error: float = _shown("peak tracking error", "m", in_tables=True)
    rms_control: float = _shown("RMS control", CONTROL, in_tables=True, on_page=True)
    peak_control: float = _shown("peak control", CONTROL)
    rms_increment: float = _shown("RMS control increment", INCREMENT, in_tables=True)
    peak_increment: float = _shown("peak control increment", INCREMENT)
    duration: float = _shown("duration", "s")
    diverged: bool = field(metadata={Metric: Metric("diverged", "1")})

    @classmethod
    def of(cls, metrics: Any, pick: Callable[[np.ndarray], Any]) -> "RunMetrics":
        """One number of every metric: `pick` chooses it from an array of runs."""
        return cls(**{name: pick(np.asarray(getattr(metrics, name))) for name in METRICS})

    def rms(self, error: str) -> float:
        """RMS of the error that counts, "contour" or "tracking" [m]."""
        return getattr(self, f"rms_{error}_error")

    def peak(self, error: str) -> float:
        """Largest of that error [m]."""
        return getattr(self, f"peak_{error}_error")


METRICS: dict[str, Metric] = {one.name: one.metadata[Metric] for one in fields(RunMetrics)}


@dataclass(frozen=True)
class FamilyMetrics:
    """Metrics of the nominal plant, and the worst of the family metric by metric."""

    nominal: RunMetrics
    worst: RunMetrics


@dataclass(frozen=True)
class MachineSummary:
    """Machine in tables and figures."""

    name: str
    control_unit: str
    axes: tuple[str, ...]
    nonsmooth_effects: str  # what the simulated machine has and the one that is tuned on has not


@dataclass(frozen=True, kw_only=True)
class LoopResult:
    """What is found of one controller on one machine."""

    machine: MachineSummary
    controller: str  # name in the catalogue
    error: str  # the error that counts, "contour" or "tracking"


@dataclass(frozen=True, kw_only=True)
class AxisSummary:
    """One axis of the nominal model, under one unit of its own control."""

    name: str
    # what settles: "speed", "position", "acceleration", or "nothing" of an axis that runs away
    kind: str
    gain: float  # the value to which it settles [m/s, m, m/s^2]; NaN of nothing
    # time to 63 % of it, the delay left out [s]; NaN where it takes longer than a hundred thousand
    # samples
    rise: float
    delay: int  # samples before anything moves
    acceleration: float  # largest [m/s^2]
    resonance: float  # of its most ringing mode [Hz]; NaN without one


@dataclass(frozen=True)
class ContourRead:
    """Summary of a contour as it was read, SI units."""

    pieces: int  # lines, arcs and polynomials of the path; moves of a program
    length: float  # of the path, rapid moves included [m]
    duration: float | None  # of the whole run, all laps [s]; of a planned motion, its cycle time
    # low, high: corners of the box around the contour [m], one number per axis
    low: tuple[float, ...]
    high: tuple[float, ...]
    ignored: tuple[str, ...] = ()  # words of the program that mean nothing for the path
    warnings: tuple[str, ...] = ()  # what of the program may be meant otherwise
    stops: str = ""  # where and why the program stops, in words
    rapid_length: float = 0.0  # of the rapid moves [m]
    # how far the tool goes along the path, more than once around it for several laps [m]; None
    # where that is the path
    way: float | None = None
    # of that way, what is behind the tool when scoring begins, at constant feed [m]
    entry: float = 0.0

    @property
    def laps(self) -> float:
        """How often the tool goes around the path; 1 where it goes along it once, or a part."""
        return 1.0 if self.way is None else max(1.0, self.way / self.length)


@dataclass(frozen=True)
class MotionSummary:
    """Summary of a jerk-limited motion, SI units."""

    cycle_time: float  # [s], rests included
    stops: int  # on the way
    deviation: float  # bound of the distance of its path from the contour [m]
    # of the cycle time under the feed, the speed, the acceleration and the jerk of an axis, and the
    # tolerance of corners; and at rest. Together they are 1.
    shares: dict[str, float]
    # jerk_limit, peak_jerk, peak_acceleration: one number per axis
    jerk_limit: tuple[float, ...]
    peak_jerk: tuple[float, ...]
    peak_acceleration: tuple[float, ...]
    gap: float = 0.0  # about the time that the planner left to gain [s]
    dwell: float = 0.0  # time that it rests, in dwells and while Z moves alone [s]


@dataclass(frozen=True)
class PeakPlace:
    """Where the largest error of a contour is, over the whole family of plants."""

    plant: str  # of the family
    error: float  # its size [m]
    time: float  # from the start of the run [s]
    position: tuple[float, ...]  # of the reference [m], one number per axis
    line: int | None = None  # of the program; None where there is no program
