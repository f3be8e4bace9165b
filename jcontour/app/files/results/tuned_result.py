"""Result of `jcontour tune`: what `result.json` and `history.json` of its run folder hold."""

from dataclasses import dataclass, field
from typing import Any

from jcontour.app.files.results.bound_results import CertifiedBound
from jcontour.app.files.results.run_metrics import (
    ContourRead,
    FamilyMetrics,
    MachineSummary,
    PeakPlace,
)
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import Verdict

WITHIN = 1e-6  # of a limit's violation: a point counts as feasible


@dataclass(frozen=True)
class LostFirst:
    """Place where the loop is lost first as its gain grows or falls.

    Attributes:
        contour: name of the training contour.
        position: of the reference there [m].
        input: whose gain it is, from 1.
    """

    contour: str
    position: tuple[float, ...]
    input: int


@dataclass(frozen=True, kw_only=True)
class PathMargins:
    """Stability margins over the training paths.

    At up to `probes_per_contour` samples of each path the gains are held at their value there: a
    linear loop that does not change with time.

    Attributes:
        spectral_radius: the largest of these loops; stable below one.
        gain_range: factors on the gain of every input that all loops bear, low and high.
        gain_search: factors between which they were sought.
        delay_samples: extra delay that all loops bear; -1 where one is unstable as it is.
        delay_search: largest delay that was tried.
        probes_per_contour: samples probed on each path.
        probes_left_out: samples where the loop is open: a control at its limit, or a zero gain.
        contours_without_margins: paths on which every probed loop is open.
        lost_first: where the smallest gain margin is; None where no place stands out.
        sensitivity: peak Ms over the whole family, at plant input and output; None where a loop is
            unstable; so is the next.
        complementary: peak Mt likewise.
        doubt: part that what is not known of the response takes of all that the loops bear; None
            where the machine says nothing of it.
        measured: peak Ms around the response that was measured; None where nothing was.
    """

    spectral_radius: float
    gain_range: tuple[tuple[float, float], ...]
    gain_search: tuple[float, float]
    delay_samples: int
    delay_search: int
    probes_per_contour: int
    probes_left_out: int
    contours_without_margins: tuple[str, ...]
    lost_first: LostFirst | None
    sensitivity: float | None = None
    complementary: float | None = None
    doubt: float | None = None
    measured: float | None = None

    @property
    def stable(self) -> bool:
        """Whether every loop is closed on some sample of each path, and none is unstable."""
        return not self.contours_without_margins and self.spectral_radius < 1


@dataclass(frozen=True, kw_only=True)
class GapRow:
    """RMS error of a training contour [m] on the smooth machine and on the one with all effects."""

    contour: str
    plant: str
    smooth: float
    nonsmooth: float
    relative: float


@dataclass(frozen=True, kw_only=True)
class RobustTest:
    """Plants of the family, its corners and gains and delays anywhere in their intervals.

    Attributes:
        members: plants that were run on every training contour, with all effects.
        diverged: how many of them diverged.
        error: largest RMS error of the others [m].
        contour: where it occurred.
        plant: on which.
        uses: largest value over its limit, of every limit that the machine states.
        users: plant and contour of that value.
    """

    members: int
    diverged: int
    error: float
    contour: str
    plant: str = ""
    uses: dict[str, float] = field(default_factory=dict)
    users: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Standstill:
    """Controls while the tool is held between two counts; the worst of the family.

    Attributes:
        rms_control: [control unit].
        rms_increment: [control unit per sample].
    """

    rms_control: float
    rms_increment: float


@dataclass(frozen=True, kw_only=True)
class ActiveLimit:
    """A limit that stops further improvement.

    Attributes:
        name: as in `limits` of the result.
        bound: its value.
        price: per cents of error that one per cent of the bound buys.
    """

    name: str
    bound: float
    price: float


@dataclass(frozen=True, kw_only=True)
class DriveLoop:
    """The nearest simple loop, with gains that a drive has.

    Attributes:
        controller: its name.
        gains: one line each, in the terms and units of drives.
        error: objective of the search with these gains [m].
        tuned_error: that of the tuned controller [m].
        kept: whether it is within every limit of the search.
    """

    controller: str
    gains: list[str]
    error: float
    tuned_error: float
    kept: bool


@dataclass(frozen=True)
class EngineRow:
    """Nominal run in an independent engine: both RMS errors and the distance of both tools [m]."""

    engine: str
    contour: str
    ours: float
    theirs: float
    apart: float


@dataclass(frozen=True, kw_only=True)
class TunedContour:
    """One contour of a tuning run, for training or held out.

    Attributes:
        samples: control steps of the motion, without those in which it settles.
        metrics: of the start weights and of the tuned ones; of a baseline where the start is not
            usable.
        read: what the contour is.
        peak: where the tuned weights leave the largest error.
        shown: whether tables and figures show it; of many contours they show some.
        feed_law: of the motion, in words.
    """

    name: str
    training: bool
    samples: int
    metrics: dict[str, FamilyMetrics]
    read: ContourRead | None = None
    peak: PeakPlace | None = None
    shown: bool = True
    feed_law: str = ""

    @property
    def compared(self) -> str:
        """Loop that the tuned one is compared with in tables."""
        return "baseline" if "baseline" in self.metrics else "start"


@dataclass(frozen=True, kw_only=True)
class TunedResult:
    """Everything that a tuning run found.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        terminal: cost at the end of an LQ controller's horizon; None for other controllers.
        model_delay: samples of the unknown delay in an LQ controller's model; None likewise.
        limitable: a constrained MPC has the same weights: `jcontour check` replays it.
        files: what a drive loads, and how it is read.
        start, weights: before and after tuning.
        weight_lines: the tuned weights with their units, for people.
        violation: logarithm of how far a limit is exceeded; None where nothing could be run.
        verdict: whether the weights may be loaded, why not, and every stated limit.
        limits: metric and bound, SI units.
        margins, start_margins: of the tuned weights and of the start.
        active: limits that stop further improvement, the dearest first.
        robust: random plants of the family; None where the family is a single plant.
        standstill: of the start weights and of the tuned ones; empty where nothing is counted.
        certified: largest error under bounded disturbances; None for a machine that is not linear.
        sample_period: of machine and controller [s].
        gap: what smoothing hides.
        confirmed: the same runs in another engine, where there is one.
        seconds: that the run took.
        drive: the nearest simple loop; None where none was tried.
    """

    machine: MachineSummary
    controller: str
    error: str
    preview: int
    terminal: str | None = None
    model_delay: int | None = None
    limitable: bool = False
    files: dict[str, str] = field(default_factory=dict)
    start: dict[str, Weight]
    weights: dict[str, Weight]
    weight_lines: list[str]
    feasible: bool
    violation: float | None
    verdict: Verdict
    active: list[ActiveLimit] = field(default_factory=list)
    robust: RobustTest | None = None
    standstill: dict[str, Standstill] = field(default_factory=dict)
    limits: dict[str, float]
    evaluated_points: int
    diverged_points: int
    diverged_starts: int
    descents: int
    plants: list[str]
    margins: PathMargins
    start_margins: PathMargins
    contours: list[TunedContour]
    gap: list[GapRow]
    training_samples: int
    confirmed: list[EngineRow]
    seconds: float
    certified: CertifiedBound | None = None
    sample_period: float
    drive: DriveLoop | None = None


@dataclass(frozen=True)
class HistoryPoint:
    """One point that the tuner evaluated.

    Attributes:
        descent: its number from 0; negative for the random points.
        weights: by name.
        objective: what is made small; NaN or infinite where it diverged.
        violation: logarithm of how far a limit is exceeded.
        diverged: a plant diverged on a contour; the point was rejected.
        rms_error: the worst of training contours and plants [m].
        rms_increment: likewise, of the control increment.
    """

    descent: int
    weights: dict[str, Weight]
    objective: float
    violation: float
    diverged: bool
    rms_error: float
    rms_increment: float

    @property
    def feasible(self) -> bool:
        """Whether it ran, within all limits."""
        return not self.diverged and not self.violation > WITHIN

    def to_json(self, error: str) -> dict[str, Any]:
        """Row of `history.json`; `error` is the one that counts."""
        return {
            "descent": self.descent,
            **self.weights,
            "objective": self.objective,
            "violation": self.violation,
            "diverged": self.diverged,
            f"rms_{error}_error": self.rms_error,
            "rms_increment": self.rms_increment,
        }
