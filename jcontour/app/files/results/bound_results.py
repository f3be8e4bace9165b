"""Results of commands with a proof: `check --bound`, `learn`."""

from dataclasses import dataclass

from jcontour.app.files.results.run_metrics import MachineSummary, PeakPlace
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
class LearnedResult:
    """Laps of a part on the family of machines."""

    machine: MachineSummary
    controller: str
    weights: dict[str, Weight]
    error: str  # the error that counts, "contour" or "tracking"
    contour: str
    feed_law: str
    samples: int
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
