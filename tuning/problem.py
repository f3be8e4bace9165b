"""A tuning problem, controller, machines, contours, objective and limits, and how much is tried."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx

from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import Batching, Score, evaluate
from jcontour.simulation.limit_use import AxisLimits, LimitUse, limit_use
from jcontour.simulation.metrics import Metrics, score_signals
from tuning.loops import Loops
from tuning.objectives import Entry, Limits, Objective, Outcome, no_limits
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


MANY = 16  # scattered points for which a program of the values alone is worth compiling


@dataclass(frozen=True)
class Effort:
    """How much a run may try: `QUICK`, `THOROUGH`, or numbers of your own.

    >>> from dataclasses import replace
    >>> replace(QUICK, seed=1).steps
    15

    Attributes:
        starts: descents, from the given weights first, then from promising scattered points.
        scatter: points evaluated after the first descent, a Sobol sequence around its best point.
        steps: of one descent; each evaluates one or two points.
        tolerance: relative gain of the objective that ends a descent when nothing promises more.
        spread: half width in ln(weight) of the box of the scattered points for up to two weights;
            with more it falls as the root of their number. Half of them fill a box of twice that.
        seed: of the Sobol sequence.
        every_start: whether every start is descended from; else a descent that ends stationary
            within the limits is the last one.
        evaluations: of a run, at most; it ends with the best until then.

    Raises:
        ValueError: a number is below its least sensible value.
    """

    starts: int
    scatter: int
    steps: int
    tolerance: float
    spread: float = 7.0  # three decades up and down
    seed: int = 0
    every_start: bool = True
    evaluations: int = 10_000  # starts and steps end a run before

    @property
    def values_alone(self) -> bool:
        """Whether scattered points are evaluated without slopes: many at a third of the cost."""
        return self.scatter >= MANY

    def __post_init__(self):
        """Check the ranges."""
        least = {"starts": 1, "scatter": 0, "spread": 0, "steps": 1, "seed": 0, "evaluations": 1}
        for name, bound in least.items():
            if getattr(self, name) < bound:
                raise ValueError(f"{name}: needs at least {bound}, received {getattr(self, name)}")
        if not self.tolerance > 0:
            raise ValueError(f"tolerance: needs to be above zero, received {self.tolerance}")


# a tenth of a per cent within a minute: less than a plant model is good for
QUICK = Effort(starts=2, scatter=6, steps=15, tolerance=1e-3, every_start=False)
# for publication; a descent rarely needs half of these steps, and most runs of two weights end
# before so many evaluations
THOROUGH = Effort(starts=10, scatter=32, steps=60, tolerance=1e-5, evaluations=400)
