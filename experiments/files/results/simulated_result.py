"""Result of `jcontour simulate`: what `result.json` of its run folder holds."""

from dataclasses import dataclass

from experiments.files.results.run_metrics import (
    ContourRead,
    MachineSummary,
    MotionSummary,
    PeakPlace,
    RunMetrics,
)
from experiments.files.results.stored import Weight
from experiments.files.results.verdict import Verdict


@dataclass(frozen=True, kw_only=True)
class VideoResult:
    """The video of a run, or the reason why there is none.

    Attributes:
        failure: one line; the other fields are None then.
        file: name in the run folder.
        pace: slower or faster than real time, in words.
        seconds: its length.
        twist_factor, error_factor: magnification of beam twist and contour error.
        peak_twist_rad: largest twist [rad].
        magnified: the same in words.
    """

    failure: str | None = None
    file: str | None = None
    pace: str | None = None
    seconds: float | None = None
    twist_factor: int | None = None
    error_factor: int | None = None
    peak_twist_rad: float | None = None
    magnified: str | None = None


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
    video: VideoResult | None = None
    verdict: Verdict
    sample_period: float | None = None
