"""Tuning problems of the catalogue's machines that searches are measured on."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.controller import Controller
from jcontour.plant import Plant
from tuning.history import FEASIBLE
from tuning.loops import Looked, Loops
from tuning.parameters import Weights
from tuning.point import evaluate_values
from tuning.problem import Problem

STATE = "contouring-lq-state"
ALONE = {"nominal_only": True, "max_sensitivity": None}
PROBLEMS: Mapping[str, Tune] = MappingProxyType(  # from cheap to dear
    {
        "square, increment limited": Tune(
            parts=("square",), controller=STATE, max_rms_increment=0.18, **ALONE
        ),
        "circle, RMS control limited": Tune(
            parts=("circle",), controller=STATE, max_rms_control=2.224, **ALONE
        ),
        "square, stage profile, increment limited": Tune(
            parts=("square",),
            controller=STATE,
            free="alpha,beta,stage",
            max_rms_increment=0.18,
            **ALONE,
        ),
        "flexible axis, cascade": Tune(
            parts=("task-a",),
            plant="flexible-axis",
            controller="cascade-feedforward",
            **ALONE,
        ),
        "circle, stage profile, Ms limited": Tune(
            parts=("circle",), free="alpha,beta,observer,stage", nominal_only=True
        ),
        "circle, family, Ms limited": Tune(parts=("circle",)),
    }
)
LOST = 100.0  # merit of a point that diverges
DEAR = 10.0  # price of a limit's excess in the merit of a search without limits of its own


class Tried(eqx.Module):
    """One point without slopes.

    Attributes:
        merit: ln f + DEAR times the largest excess ln(value / limit). Where it diverges, LOST and
            more the farther a run leaves its contour: what the tuner sees there, too.
        objective: f; infinite beyond a limit.
    """

    merit: float
    objective: float


class CountedLoops(Loops):
    """Other loops, and a count of looks at them."""

    loops: Loops
    tally: list[None] = eqx.field(static=True)

    def matrices(self, plants: Plant, controller: Controller) -> Any:
        """Those of the loops."""
        return self.loops.matrices(plants, controller)

    def look(self, matrices: Any, slopes: Any) -> tuple[Looked, Looked]:
        """What the loops show; counted."""
        self.tally.append(None)
        return self.loops.look(matrices, slopes)


def with_counted_loops(problem: Problem) -> Problem:
    """The same problem, whose looks at its loops are counted."""
    if problem.loops is None:
        return problem
    return replace(problem, loops=CountedLoops(problem.loops, []))


def looks_at(problem: Problem) -> int:
    """Number of looks at its loops so far; 0 for a problem without."""
    return len(problem.loops.tally) if isinstance(problem.loops, CountedLoops) else 0


def problem_of(name: str) -> tuple[Problem, Weights]:
    """Problem and start of a name; looks at its loops are counted."""
    run = tuning_run(PROBLEMS[name])
    return with_counted_loops(run.problem), run.start


def measure_of(problem: Problem, start: Weights) -> Callable[[Float[np.ndarray, " d"]], Tried]:
    """Function from coordinates to merit and objective."""

    def measure(z: Float[np.ndarray, " d"]) -> Tried:
        point = evaluate_values(problem, start, z)
        if point.diverged:
            return Tried(LOST + _departed(point.departures), np.inf)
        objective = point.objective
        violation = float(np.max(point.limits, initial=-np.inf))
        merit = np.log(objective) + DEAR * max(0.0, violation)
        return Tried(float(merit), objective if violation <= FEASIBLE else np.inf)

    return measure


def _departed(departures: Float[np.ndarray, " r"]) -> float:
    """How far the worst run leaves its contour, ln(error / size), between 0 and LOST."""
    worst = float(np.max(departures))
    return float(np.clip(worst, 0.0, LOST)) if np.isfinite(worst) else LOST
