"""Result of `jcontour feed`: what `result.json` of its run folder holds."""

from dataclasses import dataclass, field

from jcontour.app.files.results.run_metrics import FamilyMetrics, MachineSummary
from jcontour.app.files.results.verdict import LimitCheck, Verdict


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
