"""Result of `jcontour learn`: what `result.json` of its run folder holds."""

from dataclasses import dataclass

from jcontour.app.files.results.run_metrics import MachineSummary
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import LimitCheck, Verdict


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
