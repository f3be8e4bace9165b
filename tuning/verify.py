"""The gap table: what limits cost a tuned controller, found by replaying its weights through the constrained MPC.

The same contours, plants, observer and scores; where no limit is active the two runs are equal, so
the gap is the limits' doing.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Bool, Float

from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, OutputTerminal, Terminal
from jcontour.controllers.observers.kalman import FilterObserver
from jcontour.host.loop import Fallback, HostRun, Stopped, reported_loop
from jcontour.host.observed import ObservedHost
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.mpc.limits import Bounds, Limits
from jcontour.mpc.tracking import TrackingMPC, TrackingWeights
from jcontour.plant import Plant
from jcontour.qp.solvers import Solver
from jcontour.simulation.closed_loop import Rollout, simulate
from jcontour.simulation.metrics import Metrics, score

AT_LIMIT = 1e-7  # of the largest value: what a checked QP leaves


class Replayed(NamedTuple):
    """What is tuned and how it is fed.

    Attributes:
        model: of the machine, in the controller and in the Kalman filter.
        weights: alpha, beta, rho, stage.
        preview: horizon [samples].
        gain: of the Kalman filter (n, m); None feeds the controller the state that the plant
            measures.
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
        return (
            inner if self.gain is None else FilterObserver(inner, self.model, np.asarray(self.gain))
        )  # type: ignore

    def limited(self, limits: Limits, solver: Solver | None = None) -> TrackingMPC | ObservedHost:
        """The same weights under limits.

        Raises:
            ValueError: as `TrackingMPC`.
        """
        inner = TrackingMPC(
            self.model,
            TrackingWeights.of(self.weights),
            self.preview,
            limits,
            self.terminal,
            solver,
        )
        return inner if self.gain is None else ObservedHost(inner, self.model, self.gain)


class Gap(NamedTuple):
    """One contour on one plant.

    Attributes:
        contour, plant: names.
        without: metrics of the tuned controller.
        within: metrics under the limits; None when the run stopped.
        active_fraction: of the steps, those in which a limit was active anywhere in the plan.
        acting_fraction: of the steps, those whose control, or its change, was itself at a limit.
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
    acting_fraction: float
    residual: float
    fallbacks: int
    stopped: int | None
    failure: str
    run: HostRun


def verify(
    replayed: Replayed,
    limits: Limits,
    references: Mapping[str, Reference],
    plants: Mapping[str, Plant],
    solver: Solver | None = None,
    fallback: Fallback | None = None,
) -> Iterator[Gap]:
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
            run, stopped = _constrained(plant, constrained, reference, fallback)
            yield _gap(contour, plant_name, without, run, stopped, reference, limits)


def _constrained(
    plant: Plant, controller, reference: Reference, fallback
) -> tuple[HostRun, Stopped | None]:
    try:
        return reported_loop(plant, controller, reference, fallback=fallback), None
    except Stopped as stopped:
        return stopped.run, stopped


def _gap(
    contour: str,
    plant: str,
    without: Metrics,
    run: HostRun,
    stopped: Stopped | None,
    reference: Reference,
    limits: Limits,
) -> Gap:
    rollout: Rollout = run.rollout
    within = score(rollout, reference) if stopped is None else None
    report = run.report
    return Gap(
        contour,
        plant,
        without,
        within,
        report.active_fraction,
        acting_fraction(rollout.control, limits),
        report.worst_residual,
        report.fallbacks,
        None if stopped is None else stopped.step,
        "" if stopped is None else str(stopped),
        run,
    )


def acting_fraction(control: ArrayLike | None, limits: Limits) -> float:
    """Fraction of the steps whose control (T, p), or its change from the step before, is at a limit; 0 without a step."""
    if control is None:
        return 0.0
    u = np.asarray(control)
    at = _at(u, limits.control)
    at[1:] |= _at(np.diff(u, axis=0), limits.increment)
    return float(np.mean(at))


def _at(values: Float[np.ndarray, "T p"], bounds: Bounds | None) -> Bool[np.ndarray, " T"]:
    if bounds is None:
        return np.zeros(len(values), bool)
    low, high = (np.asarray(bound, float) for bound in bounds)
    near = AT_LIMIT * np.abs(values).max(initial=0.0)
    return np.any((values <= low + near) | (values >= high - near), axis=-1)
