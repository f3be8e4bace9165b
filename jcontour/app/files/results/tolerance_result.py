"""Result of `jcontour tolerance`: what `result.json` of its run folder holds."""

from dataclasses import dataclass

from jcontour.app.files.results.run_metrics import ContourRead, MachineSummary
from jcontour.app.files.results.verdict import Verdict


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
