"""Results of commands with a proof: `check --bound`, `tolerance`, `learn`."""

from dataclasses import dataclass

from jcontour.app.files.results.run_metrics import ContourRead, MachineSummary, PeakPlace
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import LimitCheck, Verdict


@dataclass(frozen=True, kw_only=True)
class CertifiedRow:
    """One contour on one plant of the family, SI units.

    Attributes:
        bound: largest error that the disturbances within the bounds can make, proven.
        nominal: largest error without disturbance.
        reached: largest error under the attack, encoder error chosen by it.
        counted: the same where encoders count and the attack chooses the force alone; None where
            nothing is counted.
        control: largest size of each control, proven.
        place: where the largest bound is.
    """

    contour: str
    plant: str
    bound: float
    nominal: float
    reached: float
    counted: float | None
    control: tuple[float, ...]
    place: PeakPlace


@dataclass(frozen=True, kw_only=True)
class CertifiedBound:
    """Largest error of tuned weights on what they were tuned on, proven, SI units.

    Attributes:
        force: bound on what adds to each control [control unit].
        encoder: bound on the error of every measured number, one for all or each [m].
        error: largest error that the disturbances within the bounds can make; None where there is
            no proof, as the next two.
        contour: where it is.
        plant: of which.
        refused: why there is no proof.
    """

    force: float
    encoder: float | tuple[float, ...]
    error: float | None = None
    contour: str | None = None
    plant: str | None = None
    refused: str | None = None


@dataclass(frozen=True, kw_only=True)
class CertifiedResult:
    """Largest errors of a stored loop under bounded disturbances.

    Attributes:
        certified: folder of the run whose loop it is.
        error: the error that counts, "contour" or "tracking".
        force: bound on what adds to each control [control unit].
        encoder: bound on the error of every measured number, one for all or each [m].
        control_limit: of each control; None where the machine states none.
        gain: relative; rows hold for all gains within it; None where for the plants alone.
        rows: one per contour and plant.
        verdict: whether the controls are proven to stay within their limits.
    """

    certified: str
    machine: MachineSummary
    controller: str
    error: str
    force: float
    encoder: float | tuple[float, ...]
    control_limit: tuple[float, ...] | None
    gain: float | None
    rows: list[CertifiedRow]
    verdict: Verdict

    @property
    def worst(self) -> CertifiedRow:
        """Row of the largest bound."""
        return max(self.rows, key=lambda row: row.bound)


@dataclass(frozen=True, kw_only=True)
class KeptRun:
    """One run of the bounded MPC, SI units.

    Attributes:
        plant: of the family.
        disturbance: that acted, in words.
        within: everything that acted is within the bounds, so that the tolerance holds.
        largest: largest error of the tool [m].
        left: sample at which something beyond the bounds was noticed; None where nothing was.
        fallbacks: samples whose QP had no answer within the tolerance.
        control: largest size of each control.
        residual: largest of any QP.
    """

    plant: str
    disturbance: str
    within: bool
    largest: float
    left: int | None
    fallbacks: int
    control: tuple[float, ...]
    residual: float

    def keeps(self, tolerance: float) -> bool:
        """Whether the largest error is within a tolerance [m]."""
        return self.largest <= tolerance


@dataclass(frozen=True, kw_only=True)
class ToleranceResult:
    """Tolerance of a part, and runs that keep it.

    Attributes:
        error: the error that is bounded, "contour" or "tracking".
        force: bound on what adds to each control [control unit].
        encoder: bound on the error of every measured position, one for all or each [m].
        plant: that it is promised for.
        length: samples within which the tool has recovered.
        promised: largest error [m].
        shares: of the least tolerance, by their names [m].
        limiting: limits that keep it from being smaller.
        control_limit: of each control.
        runs: of the plants of the family.
        verdict: limits of the machine, and runs within the bounds that left the tolerance.
    """

    machine: MachineSummary
    contour: str
    feed_law: str
    samples: int
    error: str
    force: float
    encoder: float | tuple[float, ...]
    plant: str
    length: int
    promised: float
    shares: dict[str, float]
    limiting: tuple[str, ...]
    control_limit: tuple[float, ...]
    read: ContourRead | None = None
    runs: list[KeptRun]
    verdict: Verdict


@dataclass(frozen=True, kw_only=True)
class LearnedMachine:
    """Laps of one machine; the lists end where it diverges.

    Attributes:
        name: of the machine.
        tool_um: RMS error of the tool, lap by lap.
        measured_um: the same error of what is measured, from which the law learns.
        control: RMS control, lap by lap.
        diverged: lap, counted from one, at which learning diverged; None where it did not.
        pays_until: lap that no later one betters by a twentieth, at the tool; None where no lap has
            a finite error.
    """

    name: str
    tool_um: list[float]
    measured_um: list[float]
    control: list[float]
    diverged: int | None = None
    pays_until: int | None

    @property
    def best_um(self) -> float | None:
        """Error of the tool where learning no longer pays; None where no lap has a finite one."""
        if self.pays_until is None:
            return None
        return self.tool_um[self.pays_until - 1]


@dataclass(frozen=True, kw_only=True)
class StoredLap:
    """The shifted reference of a lap of the linear model.

    Attributes:
        lap: counted from one.
        error_um: RMS error of the tool.
        largest_um: largest shift of an axis.
        first_um: how far its first sample is from the part, where the tool stands: a step.
        speed, acceleration: largest that it asks an axis for after that [m/s], [m/s^2].
        limits: of the machine on these; where one is not kept the reference is not written.
    """

    lap: int
    error_um: float
    largest_um: float
    first_um: float
    speed: float
    acceleration: float
    limits: list[LimitCheck]


@dataclass(frozen=True, kw_only=True)
class LearnedResult:
    """Laps of a part on the family of machines.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        law: name of the learning law.
        numbers: of the law, by name.
        laps: how many were asked for.
        ratio: largest ratio of the correction's distance from its limit, from lap to lap.
        ratio_member: machine of the family that has it.
        ratio_hz: frequency at which it is [Hz].
        proven: whether the ratio is a bound; it is an estimate where the loop or the law changes
            along the lap.
        noise_um: RMS error of the tool that noise alone makes, without learning.
        machines: the linear model, the same with noise, and the family.
        verdict: on that reference.
        stored: what is written for a control; None where no lap of the linear model betters the
            first.
    """

    machine: MachineSummary
    controller: str
    weights: dict[str, Weight]
    error: str
    contour: str
    feed_law: str
    samples: int
    law: str
    numbers: dict[str, float]
    laps: int
    ratio: float
    ratio_member: str
    ratio_hz: float
    proven: bool
    noise_um: float
    machines: list[LearnedMachine]
    verdict: Verdict
    stored: StoredLap | None = None

    @property
    def assured(self) -> bool:
        """Whether the laps converge on the whole family, known before the first."""
        return self.proven and self.ratio < 1
