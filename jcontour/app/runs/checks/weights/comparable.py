"""Runs that can be compared, and which of their numbers: the same path, motion, unit and sample."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jcontour.app.files.results.run_metrics import (
    CONTROL,
    INCREMENT,
    METRICS,
    ContourRead,
    FamilyMetrics,
    MachineSummary,
    RunMetrics,
)
from jcontour.app.files.results.simulated_result import SimulatedResult
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.tuned_result import PathMargins, TunedResult
from jcontour.app.files.results.verdict import Verdict

SAME = 1e-3  # relative: a smaller difference is called none
UNNAMED = "control unit"  # of a machine that does not say its unit


@dataclass(frozen=True, kw_only=True)
class ComparableContour:
    """One contour of a run.

    Attributes:
        training: whether the weights were tuned on it.
        metrics: of the weights of the run.
        read: what the contour is; None in folders of older versions.
        feed_law: of the motion, in words; empty likewise.
    """

    name: str
    training: bool
    metrics: FamilyMetrics
    read: ContourRead | None = None
    feed_law: str = ""


@dataclass(frozen=True, kw_only=True)
class ComparableRun:
    """What a run of `tune` and one of `simulate` have in common.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        margins: None of `simulate`, which looks at none.
        sample_period: [s]; None in folders of older versions.
    """

    machine: MachineSummary
    error: str
    weights: dict[str, Weight]
    verdict: Verdict
    contours: list[ComparableContour]
    margins: PathMargins | None = None
    sample_period: float | None = None

    @classmethod
    def of_tuned(cls, result: TunedResult) -> "ComparableRun":
        """The tuned weights on all contours."""
        contours = [
            ComparableContour(
                name=one.name,
                training=one.training,
                metrics=one.metrics["tuned"],
                read=one.read,
                feed_law=one.feed_law,
            )
            for one in result.contours
        ]
        return cls(
            machine=result.machine,
            error=result.error,
            weights=result.weights,
            verdict=result.verdict,
            contours=contours,
            margins=result.margins,
            sample_period=result.sample_period,
        )

    @classmethod
    def of_simulated(cls, result: SimulatedResult) -> "ComparableRun":
        """The controller on its one contour."""
        contour = ComparableContour(
            name=result.contour,
            training=False,
            metrics=_over_family(list(result.plants.values())),
            read=result.read,
            feed_law=result.feed_law,
        )
        return cls(
            machine=result.machine,
            error=result.error,
            weights=result.weights,
            verdict=result.verdict,
            contours=[contour],
            sample_period=result.sample_period,
        )


def _over_family(plants: list[RunMetrics]) -> FamilyMetrics:
    """The nominal plant, which is the first, and the worst of all metric by metric."""
    worst = {name: np.max([getattr(plant, name) for plant in plants]).item() for name in METRICS}
    return FamilyMetrics(plants[0], RunMetrics(**worst))


def unlike_paths(first: ComparableRun, second: ComparableRun) -> list[str]:
    """Names of contours that are not the same path in both runs, as those made for other parts."""
    return [a.name for a, b in _pairs(first, second) if _other_path(a.read, b.read)]


def unlike_motions(first: ComparableRun, second: ComparableRun) -> dict[str, list[str]]:
    """Motion in either run of every contour that is the same path, but not the same motion."""
    slack = 2 * max(one.sample_period or 0.0 for one in (first, second))
    found = {}
    for a, b in _pairs(first, second):
        if not _other_path(a.read, b.read) and _other_motion(a, b, slack):
            found[a.name] = [_motion_words(one) for one in (a, b)]
    return found


def comparable(metric: str, first: ComparableRun, second: ComparableRun) -> bool:
    """Whether a metric has the same unit in both runs; an increment is one per sample."""
    mine, other = control_units(first, second)
    units = mine == other
    if METRICS[metric].unit == INCREMENT:
        return units and same_period(first.sample_period, second.sample_period)
    return units or METRICS[metric].unit != CONTROL


def control_units(first: ComparableRun, second: ComparableRun) -> list[str]:
    """Units of the controls; one without a name is that of its machine alone."""
    machines = [first.machine, second.machine]
    units = [machine.control_unit for machine in machines]
    if units == [UNNAMED, UNNAMED] and machines[0].name != machines[1].name:
        return [f"{UNNAMED} of {machine.name}" for machine in machines]
    return units


def same_period(first: float | None, second: float | None) -> bool:
    """Whether two sample periods [s] are equal; one that is not known is taken to be."""
    return first is None or second is None or bool(np.isclose(first, second, rtol=1e-9, atol=0))


def _pairs(
    first: ComparableRun, second: ComparableRun
) -> Iterator[tuple[ComparableContour, ComparableContour]]:
    others = {contour.name: contour for contour in second.contours}
    return ((one, others[one.name]) for one in first.contours if one.name in others)


def _other_path(first: ContourRead | None, second: ContourRead | None) -> bool:
    """Whether length or box differ, beyond rounding."""
    if first is None or second is None:
        return False
    a, b = ([one.length, *one.low, *one.high] for one in (first, second))
    return len(a) != len(b) or not np.allclose(a, b, rtol=SAME, atol=SAME * first.length)


def _other_motion(first: ComparableContour, second: ComparableContour, slack: float) -> bool:
    """Whether feed law or duration differ, by more than some samples' time [s]."""
    if first.feed_law and second.feed_law and first.feed_law != second.feed_law:
        return True
    a, b = (None if one.read is None else one.read.duration for one in (first, second))
    return a is not None and b is not None and not np.isclose(a, b, rtol=SAME, atol=slack)


def _motion_words(contour: ComparableContour) -> str:
    """Feed law and duration, as far as they are known."""
    duration = None if contour.read is None else contour.read.duration
    lasting = "" if duration is None else f"{duration:.4g} s"
    return ", ".join(filter(None, [contour.feed_law, lasting])) or "-"
