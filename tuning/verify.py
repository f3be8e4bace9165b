"""The gap table: what limits at every sample cost a tuned controller.

Its weights are replayed through the constrained MPC, on the same contours, plants, observer and
scores. Where no limit is active the two runs are equal, so the gap is the limits' doing.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Bool, Float

from jcontour.controller import Controller
from jcontour.host.controller import HostController
from jcontour.host.loop import Fallback, HostRun, Stopped, reported_loop
from jcontour.motion.references import Reference
from jcontour.mpc.tracking.limits import Bounds, Limits
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import Metrics, score

AT_LIMIT = 1e-7  # of the largest value: what a checked QP leaves


class Gap(NamedTuple):
    """One contour on one plant.

    Attributes:
        contour, plant: names.
        without: metrics of the tuned controller.
        within: metrics under the limits; None when the run stopped.
        acting_fraction: of the steps, those whose control, or its change, was itself at a limit.
        stopped: step without an answer that ended the run, None when it went through.
        failure: why, in one line; empty when it went through.
        run: the constrained run, or the part of it before it stopped.
    """

    contour: str
    plant: str
    without: Metrics
    within: Metrics | None
    acting_fraction: float
    stopped: int | None
    failure: str
    run: HostRun

    @property
    def active_fraction(self) -> float:
        """Fraction of the steps in which a limit was active anywhere in the plan."""
        return self.run.report.active_fraction

    @property
    def residual(self) -> float:
        """The worst scaled residual of any QP."""
        return self.run.report.worst_residual

    @property
    def fallbacks(self) -> int:
        """Number of steps that the fallback made."""
        return self.run.report.fallbacks


def verify(
    tuned: Controller,
    constrained: HostController,
    limits: Limits,
    references: Mapping[str, Reference],
    plants: Mapping[str, Plant],
    fallback: Fallback | None = None,
) -> Iterator[Gap]:
    """Every contour on every plant, one after another as they are done.

    Args:
        tuned: the controller as it was tuned.
        constrained: the same weights under limits.
        limits: those it keeps to.
        references: by name.
        plants: by name; stacked ones have to be taken apart first (`evaluation.member`).
        fallback: what a step without an answer does; the run stops when None.

    Raises:
        ValueError: limits, preview or sample period do not fit.
    """
    for contour, reference in references.items():
        for name, plant in plants.items():
            without = score(simulate(plant, tuned, reference), reference)
            run, stopped = _constrained(plant, constrained, reference, fallback)
            yield Gap(
                contour,
                name,
                without,
                score(run.rollout, reference) if stopped is None else None,
                acting_fraction(run.rollout.control, limits),
                None if stopped is None else stopped.step,
                "" if stopped is None else str(stopped),
                run,
            )


def acting_fraction(control: Float[ArrayLike, "T p"], limits: Limits) -> float:
    """Fraction of the steps whose control (T, p), or its change, is at a limit.

    0 without a step.
    """
    u = np.asarray(control)
    if len(u) == 0:
        return 0.0
    at = _at(u, limits.control)
    at[1:] |= _at(np.diff(u, axis=0), limits.increment)
    return float(np.mean(at))


def _constrained(
    plant: Plant, controller: HostController, reference: Reference, fallback: Fallback | None
) -> tuple[HostRun, Stopped | None]:
    try:
        return reported_loop(plant, controller, reference, fallback=fallback), None
    except Stopped as stopped:
        return stopped.run, stopped


def _at(values: Float[np.ndarray, "T p"], bounds: Bounds | None) -> Bool[np.ndarray, " T"]:
    if bounds is None:
        return np.zeros(len(values), bool)
    low, high = (np.asarray(bound, float) for bound in bounds)
    near = AT_LIMIT * np.abs(values).max(initial=0.0)
    return np.any((values <= low + near) | (values >= high - near), axis=-1)
