"""The run of one design of a predictive controller, and what is kept of it.

It is a function of plain values, so that any process can compute it.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from jcontour.app.designs.predictive.sweep_designs import Case, HostedRun, PredictiveDesign
from jcontour.geometry.contour import Contour
from jcontour.host.loop import HostRun, Stopped, reported_loop
from jcontour.simulation.traversal import Score, outrun, traversal_score


class Ending(StrEnum):
    """How the run of a design ended."""

    ARRIVED = "arrived"
    LATE = "late"  # its tool had not arrived when the time was up
    OUTRUN = "outrun"  # the controller's progress came to the end of the path, its tool did not
    UNSOLVED = "unsolved"  # a quadratic program had no answer
    DIVERGED = "diverged"  # not finite, or farther from the path than this is large
    KILLED = "killed"  # every process that computed it was killed


@dataclass(frozen=True)
class PredictiveRun:
    """Numbers of one run; all but the ending are NaN where they mean nothing.

    Attributes:
        time_s: until the tool has arrived [s].
        rms_um: contour error until then, or until the end of a run that is late or outrun [um].
        peak_um: largest one, likewise [um].
        limited: fraction of the steps with a limit active in the plan.
        residual: the worst of any quadratic program.
    """

    ending: Ending
    time_s: float = float("nan")
    rms_um: float = float("nan")
    peak_um: float = float("nan")
    limited: float = float("nan")
    residual: float = float("nan")


def predictive_run(asked: tuple[Case, PredictiveDesign]) -> PredictiveRun:
    """Simulate one design and score it; what fails in the run is an ending.

    Raises:
        ValueError: as `Case.hosted`.
    """
    case, design = asked
    hosted = case.hosted(design)
    try:
        run = reported_loop(hosted.plant, hosted.controller, hosted.reference)
    except Stopped:
        return PredictiveRun(Ending.UNSOLVED)
    return ended(run, hosted, case.contour)[0]


def ended(run: HostRun, hosted: HostedRun, contour: Contour) -> tuple[PredictiveRun, Score | None]:
    """Numbers of a run that was solved, and its score; None where it is not finite."""
    rollout, progress = run.rollout, hosted.progress
    output, control = np.asarray(rollout.output), np.asarray(rollout.control)
    if not (np.isfinite(output).all() and np.isfinite(control).all()):
        return PredictiveRun(Ending.DIVERGED), None
    score = traversal_score(contour, output, hosted.plant.dt)
    if not score.peak <= float(contour.size):
        return PredictiveRun(Ending.DIVERGED), score
    ending = Ending.ARRIVED if np.isfinite(score.time) else Ending.LATE
    if progress is not None and outrun(contour, score, progress(rollout.memory)):
        ending = Ending.OUTRUN
    numbers = PredictiveRun(
        ending,
        float(score.time),
        1e6 * score.rms,
        1e6 * score.peak,
        run.report.active_fraction,
        run.report.worst_residual,
    )
    return numbers, score
