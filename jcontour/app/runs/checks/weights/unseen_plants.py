"""Limits of the tuner on plants of the family that it did not see, with --nominal-only."""

from dataclasses import dataclass, replace

import numpy as np

from jcontour.app.files.results.tuned_result import WITHIN
from jcontour.app.reports.tuned_tables import limit_words
from jcontour.app.runs.tuning.problem import TuningRun, tuning_run
from tuning.objectives import LATE
from tuning.outcome import Outcome
from tuning.parameters import Chart, Weights
from tuning.point import evaluate_values

HELP = "the tuner saw the nominal plant alone: tune without --nominal-only"


@dataclass(frozen=True)
class OverFamily:
    """Weights on the whole smooth family.

    Attributes:
        run: as it would be without --nominal-only, with the limits of the family.
        outcome: of the weights, axes (contour or probe, plant).
        violations: ln(value / bound), in the order of the limits' entries.
    """

    run: TuningRun
    outcome: Outcome
    violations: np.ndarray

    @property
    def feasible(self) -> bool:
        """Whether every plant keeps every limit."""
        return not self.outcome.diverged and bool(np.all(self.violations <= WITHIN))


def over_family(run: TuningRun, weights: Weights) -> OverFamily | None:
    """Weights on the whole family; None where the tuner has seen it."""
    if not run.flags.nominal_only or len(run.machine.family_names) == 1:
        return None
    whole = tuning_run(replace(run.flags, nominal_only=False), run.design)
    z = np.asarray(Chart(whole.problem.space, weights).coordinates())
    point = evaluate_values(whole.problem, whole.start, z)
    return OverFamily(whole, point.outcome, np.asarray(point.limits))


def exceeded_unseen(found: OverFamily | None) -> list[str]:
    """A line for every limit that a plant breaks, with the plant that breaks it most; then help."""
    if found is None:
        return []
    entries = found.run.problem.limit_entries(found.outcome)
    worst: dict[str, tuple[int, float]] = {}  # name of the limit: plant, violation
    for entry, violation in zip(entries, found.violations.tolist(), strict=True):
        excess = np.inf if np.isnan(violation) else violation
        if excess > max(WITHIN, worst.get(entry.name, (0, 0.0))[1]):
            worst[entry.name] = entry.plant, excess
    plants, bounds = found.run.scenarios.plants, found.run.limits
    lines = [_line(name, bounds[name], plants[k], excess) for name, (k, excess) in worst.items()]
    return [*lines, HELP] if lines else []


def _line(name: str, bound: float, plant: str, violation: float) -> str:
    """A limit that a plant breaks, whose value is exp(violation) times the bound."""
    if not np.isfinite(violation):
        return f"a run or a loop of the plant '{plant}' is unstable: {limit_words(name, bound)}"
    if name == LATE:
        return f"the plant '{plant}' does not bear the delay that --min-delay-margin asks for"
    excess = 100 * np.expm1(violation)
    return f"the plant '{plant}' exceeds the limit {limit_words(name, bound)} by {excess:.3g} %"
