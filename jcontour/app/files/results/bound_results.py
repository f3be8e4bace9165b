"""Results of commands with a proof: `check --bound`, `tolerance`, `learn`."""

from dataclasses import dataclass

from jcontour.app.files.results.run_metrics import ContourRead, MachineSummary, PeakPlace
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import LimitCheck, Verdict


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
class CertifiedBound:
    """Largest error of tuned weights on what they were tuned on, proven, SI units."""

    force: float  # bound on what adds to each control [control unit]
    # bound on the error of every measured number, one for all or each [m]
    encoder: float | tuple[float, ...]
    # largest error that the disturbances within the bounds can make; None where there is no proof,
    # as the next two
    error: float | None = None
    contour: str | None = None  # where it is
    plant: str | None = None  # of which
    refused: str | None = None  # why there is no proof


@dataclass(frozen=True, kw_only=True)
class CertifiedResult:
    """Largest errors of a stored loop under bounded disturbances."""

    certified: str  # folder of the run whose loop it is
    machine: MachineSummary
    controller: str
    error: str  # the error that counts, "contour" or "tracking"
    force: float  # bound on what adds to each control [control unit]
    # bound on the error of every measured number, one for all or each [m]
    encoder: float | tuple[float, ...]
    control_limit: tuple[float, ...] | None  # of each control; None where the machine states none
    # relative; rows hold for all gains within it; None where for the plants alone
    gain: float | None
    rows: list[CertifiedRow]  # one per contour and plant
    verdict: Verdict  # whether the controls are proven to stay within their limits

    @property
    def worst(self) -> CertifiedRow:
        """Row of the largest bound."""
        return max(self.rows, key=lambda row: row.bound)


@dataclass(frozen=True, kw_only=True)
class KeptRun:
    """One run of the bounded MPC, SI units."""

    plant: str  # of the family
    disturbance: str  # that acted, in words
    within: bool  # everything that acted is within the bounds, so that the tolerance holds
    largest: float  # largest error of the tool [m]
    # sample at which something beyond the bounds was noticed; None where nothing was
    left: int | None
    fallbacks: int  # samples whose QP had no answer within the tolerance
    control: tuple[float, ...]  # largest size of each control
    residual: float  # largest of any QP

    def keeps(self, tolerance: float) -> bool:
        """Whether the largest error is within a tolerance [m]."""
        return self.largest <= tolerance


@dataclass(frozen=True, kw_only=True)
class ToleranceResult:
    """Tolerance of a part, and runs that keep it."""

    machine: MachineSummary
    contour: str
    feed_law: str
    samples: int
    error: str  # the error that is bounded, "contour" or "tracking"
    force: float  # bound on what adds to each control [control unit]
    # bound on the error of every measured position, one for all or each [m]
    encoder: float | tuple[float, ...]
    plant: str  # that it is promised for
    length: int  # samples within which the tool has recovered
    promised: float  # largest error [m]
    shares: dict[str, float]  # of the least tolerance, by their names [m]
    limiting: tuple[str, ...]  # limits that keep it from being smaller
    control_limit: tuple[float, ...]  # of each control
    read: ContourRead | None = None
    runs: list[KeptRun]  # of the plants of the family
    verdict: Verdict  # limits of the machine, and runs within the bounds that left the tolerance


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
class LearnedResult:
    """Laps of a part on the family of machines."""

    machine: MachineSummary
    controller: str
    weights: dict[str, Weight]
    error: str  # the error that counts, "contour" or "tracking"
    contour: str
    feed_law: str
    samples: int
    law: str  # name of the learning law
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
