"""Result of `jcontour tune`: what `result.json` and `history.json` of its run folder hold."""

from dataclasses import dataclass, field

from jcontour.app.files.results.run_metrics import (
    ContourRead,
    FamilyMetrics,
    LoopResult,
    PeakPlace,
)
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import Verdict

WITHIN = 1e-6  # of a limit's violation: a point counts as feasible


@dataclass(frozen=True)
class LostFirst:
    """Place where the loop is lost first as its gain grows or falls."""

    contour: str  # name of the training contour
    position: tuple[float, ...]  # of the reference there [m]
    input: int  # whose gain it is, from 1


@dataclass(frozen=True, kw_only=True)
class PathMargins:
    """Stability margins over the training paths.

    At up to `probes_per_contour` samples of each path the gains are held at their value there: a
    linear loop that does not change with time.
    """

    spectral_radius: float  # the largest of these loops; stable below one
    # factors on the gain of every input that all loops bear, low and high
    gain_range: tuple[tuple[float, float], ...]
    gain_search: tuple[float, float]  # factors between which they were sought
    delay_samples: int  # extra delay that all loops bear; -1 where one is unstable as it is
    delay_search: int  # largest delay that was tried
    probes_per_contour: int  # samples probed on each path
    probes_left_out: int  # samples where the loop is open: a control at its limit, or a zero gain
    contours_without_margins: tuple[str, ...]  # paths on which every probed loop is open
    # where the smallest gain margin is; None where no place stands out
    lost_first: LostFirst | None
    # peak Ms over the whole family, at plant input and output; None where a loop is unstable; so is
    # the next
    sensitivity: float | None = None
    complementary: float | None = None  # peak Mt likewise
    # part that what is not known of the response takes of all that the loops bear; None where the
    # machine says nothing of it
    uncertainty: float | None = None
    # peak Ms around the response that was measured; None where nothing was
    measured: float | None = None

    @property
    def stable(self) -> bool:
        """Whether every loop is closed on some sample of each path, and none is unstable."""
        return not self.contours_without_margins and self.spectral_radius < 1


@dataclass(frozen=True, kw_only=True)
class RobustTest:
    """Plants of the family, its corners and gains and delays anywhere in their intervals."""

    members: int  # plants that were run on every training contour, with all effects
    diverged: int  # how many of them diverged
    error: float  # largest RMS error of the others [m]
    contour: str  # where it occurred
    plant: str = ""  # on which
    # largest value over its limit, of every limit that the machine states
    uses: dict[str, float] = field(default_factory=dict)
    users: dict[str, str] = field(default_factory=dict)  # plant and contour of that value


@dataclass(frozen=True, kw_only=True)
class Standstill:
    """Controls while the tool is held between two counts; the worst of the family."""

    rms_control: float  # [control unit]
    rms_increment: float  # [control unit per sample]


@dataclass(frozen=True, kw_only=True)
class ActiveLimit:
    """A limit that stops further improvement."""

    name: str  # as in `limits` of the result
    bound: float  # its value
    price: float  # per cents of error that one per cent of the bound buys


@dataclass(frozen=True, kw_only=True)
class DriveLoop:
    """The nearest simple loop, with gains that a drive has."""

    controller: str  # its name
    weights: dict[str, Weight]  # its gains, SI
    error: float  # objective of the search with these gains [m]
    tuned_error: float  # that of the tuned controller [m]
    kept: bool  # whether it is within every limit of the search
    sensitivity: float | None = None  # peak Ms of its loops; None where no loop was looked at


@dataclass(frozen=True, kw_only=True)
class TunedContour:
    """One contour of a tuning run, for training or held out."""

    name: str
    training: bool
    samples: int  # control steps of the motion, without those in which it settles
    # of the start weights and of the tuned ones; of a baseline where the start is not usable
    metrics: dict[str, FamilyMetrics]
    read: ContourRead | None = None  # what the contour is
    peak: PeakPlace | None = None  # where the tuned weights leave the largest error
    shown: bool = True  # whether tables and figures show it; of many contours they show some
    feed_law: str = ""  # of the motion, in words

    @property
    def compared(self) -> str:
        """Loop that the tuned one is compared with in tables."""
        return "baseline" if "baseline" in self.metrics else "start"


@dataclass(frozen=True, kw_only=True)
class TunedResult(LoopResult):
    """Everything that a tuning run results in."""

    preview: int
    # cost at the end of an LQ controller's horizon; None for other controllers
    terminal: str | None = None
    # samples of the unknown delay in an LQ controller's model; None likewise
    model_delay: int | None = None
    limitable: bool = False  # a constrained MPC has the same weights: `jcontour check` replays it
    files: dict[str, str] = field(default_factory=dict)  # what a drive loads, and how it is read
    # start, weights: before and after tuning
    start: dict[str, Weight]
    weights: dict[str, Weight]
    weight_lines: list[str]  # the tuned weights with their units, for people
    feasible: bool
    # logarithm of how far a limit is exceeded; None where nothing could be run
    violation: float | None
    verdict: Verdict  # whether the weights may be loaded, why not, and every stated limit
    # limits that stop further improvement, the dearest first
    active: list[ActiveLimit] = field(default_factory=list)
    # random plants of the family; None where the family is a single plant
    robust: RobustTest | None = None
    # of the start weights and of the tuned ones; empty where nothing is counted
    standstill: dict[str, Standstill] = field(default_factory=dict)
    limits: dict[str, float]  # metric and bound, SI units
    evaluated_points: int
    diverged_points: int
    diverged_starts: int
    descents: int
    plants: list[str]
    # margins, start_margins: of the tuned weights and of the start
    margins: PathMargins
    start_margins: PathMargins
    baseline_margins: PathMargins | None = None  # of a baseline, where there is one
    contours: list[TunedContour]
    training_samples: int
    seconds: float  # that the run took
    sample_period: float  # of machine and controller [s]
    drive: DriveLoop | None = None  # the nearest simple loop; None where none was tried


@dataclass(frozen=True)
class HistoryPoint:
    """One point that the tuner evaluated."""

    descent: int  # its number from 0; negative for the random points
    weights: dict[str, Weight]  # by name
    objective: float  # what is made small; NaN or infinite where it diverged
    violation: float  # logarithm of how far a limit is exceeded
    diverged: bool  # a plant diverged on a contour; the point was rejected
    rms_error: float  # the worst of training contours and plants [m]
    rms_increment: float  # likewise, of the control increment
    sensitivity: float | None = None  # peak Ms of its loops; None where no loop was looked at

    @property
    def feasible(self) -> bool:
        """Whether it ran, within all limits."""
        return not self.diverged and not self.violation > WITHIN
