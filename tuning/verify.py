"""The gap table: what limits cost a tuned controller, found by replaying its weights through the constrained MPC.

The same contours, plants, observer and scores; where no limit is active the two runs are equal, so the gap is the limits' doing.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights, OutputTerminal, Terminal
from jcontour.controllers.observers import FilterObserver
from jcontour.linear import LinearPlant
from jcontour.metrics import Metrics, score
from jcontour.mpc.limits import Limits
from jcontour.mpc.loop import Fallback, Run, Stopped, reported_loop
from jcontour.mpc.observed import ObservedHost
from jcontour.mpc.solvers import Solver
from jcontour.mpc.tracking import TrackingMPC, TrackingWeights
from jcontour.plant import Plant
from jcontour.references import Reference
from jcontour.simulation import Rollout, simulate


class Replayed(NamedTuple):
    """What is tuned and how it is fed.

    Attributes:
        model: of the machine, in the controller and in the Kalman filter.
        weights: alpha, beta, rho, stage.
        preview: horizon [samples].
        gain: of the Kalman filter (n, m); None feeds the controller the state that the plant measures.
        terminal: of the controller.
    """

    model: LinearPlant
    weights: LQWeights
    preview: int
    gain: ArrayLike | None = None
    terminal: Terminal = OutputTerminal()

    def unlimited(self) -> ContouringLQ | FilterObserver:
        """The controller as it was tuned."""
        inner = ContouringLQ(self.model, self.weights, self.preview, self.terminal)
        return inner if self.gain is None else FilterObserver(inner, self.model, np.asarray(self.gain))  # type: ignore

    def limited(self, limits: Limits, solver: Solver | None = None) -> TrackingMPC | ObservedHost:
        """The same weights under limits.

        Raises:
            ValueError: as `TrackingMPC`.
        """
        inner = TrackingMPC(self.model, TrackingWeights.of(self.weights), self.preview, limits, self.terminal, solver)
        return inner if self.gain is None else ObservedHost(inner, self.model, self.gain)


class Gap(NamedTuple):
    """One contour on one plant.

    Attributes:
        contour, plant: names.
        without: metrics of the tuned controller.
        within: metrics under the limits; None when the run stopped.
        active_fraction: of the steps, those in which a limit was active.
        residual: the worst of any QP.
        fallbacks: steps that the fallback made.
        stopped: step without an answer that ended the run, None when it went through.
        failure: why, in one line; empty when it went through.
        run: the constrained run, or the part of it before it stopped.
    """

    contour: str
    plant: str
    without: Metrics
    within: Metrics | None
    active_fraction: float
    residual: float
    fallbacks: int
    stopped: int | None
    failure: str
    run: Run


def verify(
    replayed: Replayed, limits: Limits, references: Mapping[str, Reference], plants: Mapping[str, Plant], solver: Solver | None = None,
    fallback: Fallback | None = None,
) -> Iterator[Gap]:  # fmt: skip
    """Every contour on every plant, one after another as they are done.

    Args:
        replayed: the tuned controller.
        limits: of the machine.
        references: by name.
        plants: by name; stacked ones have to be taken apart first (`evaluation.member`).
        solver: of the QPs; DAQP when not given.
        fallback: what a step without an answer does; the run stops when None.

    Raises:
        ValueError: limits, weights, preview or sample period do not fit.
    """
    tuned, constrained = replayed.unlimited(), replayed.limited(limits, solver)
    for contour, reference in references.items():
        for plant_name, plant in plants.items():
            without = score(simulate(plant, tuned, reference), reference)
            yield _gap(contour, plant_name, without, *_constrained(plant, constrained, reference, fallback), reference)


def _constrained(plant: Plant, controller, reference: Reference, fallback) -> tuple[Run, Stopped | None]:
    try:
        return reported_loop(plant, controller, reference, fallback=fallback), None
    except Stopped as stopped:
        return stopped.run, stopped


def _gap(contour: str, plant: str, without: Metrics, run: Run, stopped: Stopped | None, reference: Reference) -> Gap:
    rollout: Rollout = run.rollout
    within = score(rollout, reference) if stopped is None else None
    report = run.report
    return Gap(
        contour, plant, without, within, report.active_fraction, report.worst_residual, report.fallbacks,
        None if stopped is None else stopped.step, "" if stopped is None else str(stopped), run,
    )  # fmt: skip
