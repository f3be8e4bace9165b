"""Result of `jcontour simulate`: what `result.json` of its run folder holds."""

from dataclasses import dataclass

from jcontour.app.files.results.run_metrics import (
    ContourRead,
    MachineSummary,
    MotionSummary,
    PeakPlace,
    RunMetrics,
)
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import Verdict


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
        sample_period: of machine and controller [s]; None in folders of older versions.
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
    sample_period: float | None = None
