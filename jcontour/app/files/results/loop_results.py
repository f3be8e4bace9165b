"""Results of commands that run one loop, or prove what it keeps."""

from dataclasses import dataclass, field

from jcontour.app.files.results.run_metrics import (
    ContourRead,
    LoopResult,
    MotionSummary,
    PeakPlace,
    RunMetrics,
)
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import LimitCheck, Verdict


@dataclass(frozen=True, kw_only=True)
class ContourResult(LoopResult):
    """The same on one contour."""

    weights: dict[str, Weight]
    contour: str
    feed_law: str
    samples: int


@dataclass(frozen=True, kw_only=True)
class SimulatedResult(ContourResult):
    """One controller on one contour, over the family of plants."""

    preview: int
    # cost at the end of an LQ controller's horizon; None for other controllers
    terminal: str | None = None
    model_delay: int | None = None
    plants: dict[str, RunMetrics]  # metrics by plant, the nominal one first
    read: ContourRead | None = None  # what the contour is
    peak: PeakPlace | None = None  # where the largest error is
    # largest control of each input over every plant and sample, scored or not, by `peak_controls`
    peak_controls: tuple[float, ...] = ()
    motion: MotionSummary | None = None  # what is asked of the machine, where it is limited in jerk
    verdict: Verdict  # every stated limit of the machine, and plants that diverge
    sample_period: float  # of machine and controller [s]


@dataclass(frozen=True, kw_only=True)
class CauseShare:
    """Share of one cause in a measured error."""

    kind: str  # of `tuning.identification.error_causes.Kind`
    axis: str  # name; empty where it is all of them
    rms: float  # in the RMS error [m]
    peak: float  # in the largest [m]
    text: str  # the cause with its numbers
    remedy: str = ""  # what to change on the control; empty where nothing is known


@dataclass(frozen=True, kw_only=True)
class AuditedResult(SimulatedResult):
    """A measured run, with the causes of its error."""

    words: list[str]  # where the signals were in the log, and what was done to them
    lags: list[float | None]  # of the axes behind their commands [s]; None of one that rests
    # the largest share first, the unexplained part last; together they are the error
    causes: list[CauseShare]


@dataclass(frozen=True, kw_only=True)
class BentResult(LoopResult):
    """Errors along the reference as it is, and along the bent one."""

    contour: str
    samples: int
    roughness: float  # price of the correction's bends
    largest: float  # largest shift of the reference [m]
    # largest distance of the G-code's moves, at their feeds, from the bent reference at the same
    # time [m]; None of one axis
    chord: float | None
    moves: int  # of the G-code
    # before, after: metrics by plant, the nominal one first
    before: dict[str, RunMetrics]
    after: dict[str, RunMetrics]
    # of the machine, along the bent reference; of the reference itself those that it exceeds
    limits: list[LimitCheck]
    # of the machine, along the reference as it is
    limits_before: list[LimitCheck] = field(default_factory=list)
    # largest speed [m/s] and acceleration [m/s^2] of an axis along the bent reference
    asked: tuple[float, float] = (0.0, 0.0)
    # places where the G-code stops, as the program does more there than move its axes
    halts: int = 0
    ramps: int = 0  # moves of the program along which Z moves too; the G-code leaves Z alone
    # what the machine states no limit of, of speed, acceleration and control
    unlimited: tuple[str, ...] = ()
    weights: tuple[str, ...] = ()  # of the controller, a line for each
    warnings: tuple[str, ...] = ()  # what of the program may be meant otherwise
    # how long the last point is held, until the tools rest [s]; scored like the run. None of a run
    # that ends in motion.
    held: float | None = 0.0
    rests: bool = True  # whether they rest by then
    # largest acceleration of an axis from one feed of the G-code to the next [m/s^2]
    changing: float = 0.0
    verdict: Verdict | None = None  # on the bent reference

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
    """A compiler's check of the exported C code."""

    compiler: str  # and its flags
    difference: float  # largest, of the controls to those of the run [control unit]
    # of a sample, the median; `slow` of the slowest in a thousand, `slowest` of all
    nanoseconds: float
    slow: float
    slowest: float
    code_bytes: int  # of the compiled law, its constants included; 0 where not known
    memory_bytes: int  # that it remembers


@dataclass(frozen=True, kw_only=True)
class ExportedResult:
    """A controller as code."""

    exported: str  # folder of the run
    controller: str  # its name
    machine: str  # its name
    contour: str  # that the code is checked on
    samples: int  # of that run
    preview: int  # samples ahead that the law needs
    states: int  # numbers that the controller remembers
    control_unit: str  # unit of the controls
    difference: float  # largest of the law's controls to those of `simulate` [control unit]
    largest_control: float  # of the run [control unit]
    precision: str  # of the numbers, double or single
    limits: list[str]  # that the law keeps, in words
    files: dict[str, str]  # name and meaning of every file
    # checks by the compilers of this computer
    compiled: list[Compiled] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)  # what speaks against loading it


@dataclass(frozen=True, kw_only=True)
class InLinuxcncRow:
    """A program in LinuxCNC; errors are distances from the commanded path [m], times in s."""

    contour: str  # name of the program
    # real_rms, real_peak: in its servo thread
    real_rms: float
    real_peak: float
    pid_rms: float  # likewise, with its own PID, tuned by Ziegler and Nichols
    # simulated_rms, simulated_peak: of `simulate`, its planner's samples as the reference
    simulated_rms: float
    simulated_peak: float
    planned_rms: float  # of `simulate` on our own plan
    real_time: float  # from the first to the last motion that its planner commands
    planned_time: float  # of our own plan
    samples: int  # that were compared


@dataclass(frozen=True, kw_only=True)
class InLinuxcncResult:
    """A stored loop in LinuxCNC."""

    checked: str  # folder of the run
    controller: str  # its name
    machine: str  # its name
    period: float  # of the servo thread [s]
    rows: list[InLinuxcncRow]  # one for each program


@dataclass(frozen=True, kw_only=True)
class CertifiedRow:
    """One contour on one plant of the family, SI units."""

    contour: str
    plant: str
    bound: float  # largest error that the disturbances within the bounds can make, proven
    nominal: float  # largest error without disturbance
    reached: float  # largest error under the attack, encoder error chosen by it
    # the same where encoders count and the attack chooses the force alone; None where nothing is
    # counted
    counted: float | None
    control: tuple[float, ...]  # largest size of each control, proven
    place: PeakPlace  # where the largest bound is


@dataclass(frozen=True, kw_only=True)
class CertifiedResult(LoopResult):
    """Largest errors of a stored loop under bounded disturbances."""

    certified: str  # folder of the run whose loop it is
    force: float  # bound on what adds to each control [control unit]
    # bound on the error of every measured number, one for all or each [m]
    encoder: float | tuple[float, ...]
    control_limit: tuple[float, ...] | None  # of each control; None where the machine states none
    rows: list[CertifiedRow]  # one per contour and plant
    verdict: Verdict  # whether the controls are proven to stay within their limits

    @property
    def worst(self) -> CertifiedRow:
        """Row of the largest bound."""
        return max(self.rows, key=lambda row: row.bound)


@dataclass(frozen=True, kw_only=True)
class LearnedMachine:
    """Laps of one machine; the lists end where it diverges."""

    name: str  # of the machine
    tool_um: list[float]  # RMS error of the tool, lap by lap
    measured_um: list[float]  # the same error of what is measured, from which the law learns
    control: list[float]  # RMS control, lap by lap
    # lap, counted from one, at which learning diverged; None where it did not
    diverged: int | None = None
    # lap that no later one betters by a twentieth, at the tool; None where no lap has a finite
    # error
    pays_until: int | None

    @property
    def best_um(self) -> float | None:
        """Error of the tool where learning no longer pays; None where no lap has a finite one."""
        if self.pays_until is None:
            return None
        return self.tool_um[self.pays_until - 1]


@dataclass(frozen=True, kw_only=True)
class StoredLap:
    """The shifted reference of a lap of the linear model."""

    lap: int  # counted from one
    error_um: float  # RMS error of the tool
    largest_um: float  # largest shift of an axis
    first_um: float  # how far its first sample is from the part, where the tool stands: a step
    # speed, acceleration: largest that it asks an axis for after that [m/s], [m/s^2]
    speed: float
    acceleration: float
    # of the machine on these; where one is not kept the reference is not written
    limits: list[LimitCheck]


@dataclass(frozen=True, kw_only=True)
class LearnedResult(ContourResult):
    """Laps of a part on the family of machines."""

    numbers: dict[str, float]  # of the law, by name
    laps: int  # how many were asked for
    ratio: float  # largest ratio of the correction's distance from its limit, from lap to lap
    ratio_member: str  # machine of the family that has it
    ratio_hz: float  # frequency at which it is [Hz]
    # whether the ratio is a bound; it is an estimate where the loop or the law changes along the
    # lap
    proven: bool
    noise_um: float  # RMS error of the tool that noise alone makes, without learning
    machines: list[LearnedMachine]  # the linear model, the same with noise, and the family
    verdict: Verdict  # on that reference
    # what is written for a control; None where no lap of the linear model betters the first
    stored: StoredLap | None = None

    @property
    def assured(self) -> bool:
        """Whether the laps converge on the whole family, known before the first."""
        return self.proven and self.ratio < 1
