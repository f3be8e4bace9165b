"""Result of `jcontour sweep`: what `result.json` of its run folder holds."""

from dataclasses import dataclass, field

from jcontour.app.files.results.stored import BESIDE_OTHERS


@dataclass(frozen=True)
class BestDesign:
    """The best weights with one preview within the limits, by the worst error of all runs.

    Of errors that are alike, those of the calmest control are the best.

    Attributes:
        preview: [samples].
        weights: those that vary, by name.
        worst_um: worst RMS error [um].
        nominal_um: worst RMS error over the contours on the nominal plant [um].
        sensitivity: peak Ms of the frozen loops over the family; None where one is unstable.
        delay_samples: extra delay that the nominal loops bear; -1 where one is unstable as it is.
        looked: designs whose loops were looked at, the best first, until one kept the limits.
        beyond: limits on loops that it breaks, with its values, SI; none did better.
    """

    preview: int
    weights: dict[str, float] = field(metadata=BESIDE_OTHERS)
    worst_um: float
    nominal_um: float
    sensitivity: float | None
    delay_samples: int
    looked: int = 1
    beyond: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SweepResult:
    """Summary of a sweep; all numbers are in its netCDF file.

    Attributes:
        points: designs with their previews.
        diverged: points that diverge on any plant along any contour.
        within: points that do not, and whose runs keep the limits of the flags.
        best: one design for every preview with which any is within the limits.
    """

    points: int
    diverged: int
    within: int
    best: list[BestDesign]
