"""Results of commands that run one loop: `simulate`, `feed`, `precompensate`, `trace`, `export`."""

from dataclasses import dataclass, field

from jcontour.app.files.results.run_metrics import (
    ContourRead,
    FamilyMetrics,
    MachineSummary,
    MotionSummary,
    PeakPlace,
    RunMetrics,
)
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import LimitCheck, Verdict


@dataclass(frozen=True, kw_only=True)
class SimulatedResult:
    """One controller on one contour, over the family of plants.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        terminal: cost at the end of an LQ controller's horizon; None for other controllers.
        plants: metrics by plant, the nominal one first.
        read: what the contour is.
        peak: where the largest error is.
        motion: what is asked of the machine, where it is limited in jerk.
        verdict: every stated limit of the machine, and plants that diverge.
        sample_period: of machine and controller [s].
    """

    machine: MachineSummary
    controller: str
    weights: dict[str, Weight]
    error: str
    contour: str
    feed_law: str
    samples: int
    preview: int
    terminal: str | None = None
    model_delay: int | None = None
    plants: dict[str, RunMetrics]
    read: ContourRead | None = None
    peak: PeakPlace | None = None
    motion: MotionSummary | None = None
    verdict: Verdict
    sample_period: float


@dataclass(frozen=True, kw_only=True)
class CauseShare:
    """Share of one cause in a measured error.

    Attributes:
        kind: of `tuning.identification.error_causes.Kind`.
        axis: name; empty where it is all of them.
        rms: in the RMS error [m].
        peak: in the largest [m].
        text: the cause with its numbers.
        remedy: what to change on the control; empty where nothing is known.
    """

    kind: str
    axis: str
    rms: float
    peak: float
    text: str
    remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class AuditedResult(SimulatedResult):
    """A measured run, with the causes of its error.

    Attributes:
        words: where the signals were in the log, and what was done to them.
        lags: of the axes behind their commands [s].
        causes: the largest share first, the unexplained part last; together they are the error.
    """

    words: list[str]
    lags: list[float]
    causes: list[CauseShare]


@dataclass(frozen=True, kw_only=True)
class FeedPoint:
    """One feed.

    Attributes:
        override: per cent of the programmed feed.
        cycle_time: of the whole run, with its rapid moves and rests, or of one of its laps [s].
        metrics: of the nominal plant, and the worst of the family metric by metric.
        diverged: plants that diverge.
        limits: of the machine.
        deviation: of the motion itself from the part, in blended corners, at most [m].
        planned: a line for every limit that the motion itself exceeds.
        not_followed: a line where the tool does not follow the motion.
    """

    override: float
    cycle_time: float
    metrics: FamilyMetrics
    diverged: list[str]
    limits: list[LimitCheck]
    deviation: float = 0.0
    planned: list[str] = field(default_factory=list)
    not_followed: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Every plant follows, within the machine's limits."""
        follows = not self.diverged and not self.not_followed
        return follows and all(one.kept for one in self.limits)


@dataclass(frozen=True, kw_only=True)
class FeedResult:
    """Error against cycle time.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        tolerance: largest error that is allowed [m]; None where none is given.
        points: from the slowest feed to the quickest.
        recommended: its override; None where no feed will do, or only a tolerance names one.
        verdict: on the feed that is recommended.
        tuned: whether the loop is one of `jcontour tune`.
    """

    machine: MachineSummary
    controller: str
    contour: str
    error: str
    tolerance: float | None
    points: list[FeedPoint]
    recommended: float | None
    verdict: Verdict
    tuned: bool = False

    @property
    def undecided(self) -> bool:
        """Whether several feeds will do, and only a tolerance names one."""
        return self.recommended is None and self.verdict.usable

    @property
    def corners_decide(self) -> bool:
        """Whether the motion itself leaves the part by the whole tolerance."""
        if self.tolerance is None:
            return False
        return self.tolerance <= min(point.deviation for point in self.points)


@dataclass(frozen=True, kw_only=True)
class BentResult:
    """Errors along the reference as it is, and along the bent one.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        roughness: price of the correction's bends.
        largest: largest shift of the reference [m].
        chord: largest distance of the G-code's moves, at their feeds, from the bent reference at
            the same time [m]; None of one axis.
        moves: of the G-code.
        halts: places where the G-code stops, as the program does more there than move its axes.
        ramps: moves of the program along which Z moves too; the G-code leaves Z alone.
        before, after: metrics by plant, the nominal one first.
        asked: largest speed [m/s] and acceleration [m/s^2] of an axis along the bent reference.
        limits: of the machine, along the bent reference; of the reference itself those that it
            exceeds.
        limits_before: of the machine, along the reference as it is.
        unlimited: what the machine states no limit of, of speed, acceleration and control.
        weights: of the controller, a line for each.
        doubts: what of the program may be meant otherwise.
        held: how long the last point is held, until the tools rest [s]; scored like the run. None
            of a run that ends in motion.
        rests: whether they rest by then.
        changing: largest acceleration of an axis from one feed of the G-code to the next [m/s^2].
        verdict: on the bent reference.
    """

    machine: MachineSummary
    controller: str
    contour: str
    error: str
    samples: int
    roughness: float
    largest: float
    chord: float | None
    moves: int
    before: dict[str, RunMetrics]
    after: dict[str, RunMetrics]
    limits: list[LimitCheck]
    limits_before: list[LimitCheck] = field(default_factory=list)
    asked: tuple[float, float] = (0.0, 0.0)
    halts: int = 0
    ramps: int = 0
    unlimited: tuple[str, ...] = ()
    weights: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    held: float | None = 0.0
    rests: bool = True
    changing: float = 0.0
    verdict: Verdict | None = None

    def _rms(self, runs: dict[str, RunMetrics]) -> list[float]:
        return [run.rms(self.error) for run in runs.values()]

    @property
    def nominal(self) -> tuple[float, float]:
        """RMS error of the nominal machine before and after [m]."""
        return self._rms(self.before)[0], self._rms(self.after)[0]

    @property
    def worst(self) -> tuple[float, float]:
        """The worst RMS error of the family before and after [m]."""
        return max(self._rms(self.before)), max(self._rms(self.after))

    @property
    def nominal_gain(self) -> float:
        """How many times smaller the nominal RMS error is."""
        return _ratio(*self.nominal)

    @property
    def worst_gain(self) -> float:
        """How many times smaller the worst RMS error of the family is."""
        return _ratio(*self.worst)


def _ratio(before: float, after: float) -> float:
    return before / max(after, 1e-15)


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """A compiler's check of the exported C code.

    Attributes:
        compiler: and its flags.
        difference: largest, of the controls to those of the run [control unit].
        nanoseconds: of a sample, the median; `slow` of the slowest in a thousand, `slowest` of all.
        code_bytes: of the compiled law, its constants included; 0 where not known.
        memory_bytes: that it remembers.
    """

    compiler: str
    difference: float
    nanoseconds: float
    slow: float
    slowest: float
    code_bytes: int
    memory_bytes: int


@dataclass(frozen=True, kw_only=True)
class ExportedResult:
    """A controller as code.

    Attributes:
        exported: folder of the run.
        controller: its name.
        machine: its name.
        contour: that the code is checked on.
        samples: of that run.
        preview: samples ahead that the law needs.
        states: numbers that the controller remembers.
        control_unit: unit of the controls.
        difference: largest of the law's controls to those of `simulate` [control unit].
        largest_control: of the run [control unit].
        precision: of the numbers, double or single.
        limits: that the law keeps, in words.
        files: name and meaning of every file.
        compiled: checks by the compilers of this computer.
        warnings: what speaks against loading it.
    """

    exported: str
    controller: str
    machine: str
    contour: str
    samples: int
    preview: int
    states: int
    control_unit: str
    difference: float
    largest_control: float
    precision: str
    limits: list[str]
    files: dict[str, str]
    compiled: list[Compiled] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class InLinuxcncRow:
    """A program in LinuxCNC; errors are distances from the commanded path [m], times in s.

    Attributes:
        contour: name of the program.
        real_rms, real_peak: in its servo thread.
        pid_rms: likewise, with its own PID, tuned by Ziegler and Nichols.
        simulated_rms, simulated_peak: of `simulate`, its planner's samples as the reference.
        planned_rms: of `simulate` on our own plan.
        real_time: from the first to the last motion that its planner commands.
        planned_time: of our own plan.
        samples: that were compared.
    """

    contour: str
    real_rms: float
    real_peak: float
    pid_rms: float
    simulated_rms: float
    simulated_peak: float
    planned_rms: float
    real_time: float
    planned_time: float
    samples: int


@dataclass(frozen=True, kw_only=True)
class InLinuxcncResult:
    """A stored loop in LinuxCNC.

    Attributes:
        checked: folder of the run.
        controller: its name.
        machine: its name.
        period: of the servo thread [s].
        rows: one for each program.
    """

    checked: str
    controller: str
    machine: str
    period: float
    rows: list[InLinuxcncRow]
