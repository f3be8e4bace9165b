"""A tuning problem: controller, machines, contours, objective and limits."""

from collections.abc import Callable
from typing import Any

import equinox as eqx

from jcontour.bounds.disturbed_family import DisturbedFamily
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import Batching, Score, evaluate
from jcontour.simulation.limit_use import AxisLimits, LimitUse, limit_use
from jcontour.simulation.metrics import Metrics, score_signals
from tuning.loops import Loops
from tuning.objectives import Entry, Limits, Objective, no_limits
from tuning.outcome import Outcome
from tuning.parameters import Weights


class Problem(eqx.Module):
    """A tuning problem.

    Args:
        build: weights -> controller; traced, so that gradients flow through it.
        plants: the family, stacked; every member counts.
        references: the training contours, stacked.
        objective: outcome (contour, plant) -> rows of values (g, v), see `objectives`.
        limits: outcome -> vector that must not be above zero.
        space: one parameter per weight, see `parameters`.
        window: samples a..b-1 that are scored; all when None.
        batching: how contours are batched, on one device or on several (`devices.Spread`); chosen
            by the platform when None.
        loops: how the frozen loops are looked at, `ProbedLoops` for instance; they are not when
            None.
        axis_limits: limits of the machine, whose use is looked at; it is not when None.
        disturbed: the family under bounded disturbances, whose largest errors are found; they are
            not when None.
    """

    build: Callable[[Weights], Controller] = eqx.field(static=True)
    plants: Plant
    references: Reference
    objective: Objective
    space: object
    limits: Limits = no_limits
    window: tuple[int, int] | None = eqx.field(static=True, default=None)
    batching: Batching | None = eqx.field(static=True, default=None)
    loops: Loops | None = None
    axis_limits: AxisLimits | None = None
    disturbed: DisturbedFamily | None = None

    def metrics(self, weights: Weights) -> Metrics:
        """Metrics (contour, plant) of the controller that the weights build."""
        return self._evaluated(self.build(weights), score_signals)

    def runs(self, weights: Weights) -> tuple[Metrics, LimitUse | None]:
        """Metrics, and use of the machine's limits where the problem asks for it."""
        controller = self.build(weights)
        if self.axis_limits is None:
            return self._evaluated(controller, score_signals), None
        return self._evaluated(controller, self._score_with_use)

    def limit_entries(self, outcome: Outcome) -> list[Entry]:
        """Names of the entries of the limits, in their order.

        Limits that cannot tell are numbered.
        """
        entries = getattr(self.limits, "entries", None)
        if entries is not None:
            return entries(outcome)
        return [Entry("limit", k, 0) for k in range(self.limits(outcome).size)]

    def _evaluated(self, controller: Controller, score: Score) -> Any:
        return evaluate(self.plants, controller, self.references, self.window, self.batching, score)

    def _score_with_use(self, output, control, reference, window) -> tuple[Metrics, LimitUse]:
        assert self.axis_limits is not None
        use = limit_use(output, control, reference, self.axis_limits)
        return score_signals(output, control, reference, window), use
