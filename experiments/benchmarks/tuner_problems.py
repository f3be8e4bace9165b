"""Tuning problems of the catalogue's machines that searches are measured on."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.options import Tune
from experiments.runs.tuning import tuning_run
from tuning.history import FEASIBLE
from tuning.outcome import Outcome
from tuning.parameters import Chart, Weights
from tuning.point import objective_value
from tuning.problem import Problem

STATE = "contouring-lq-state"
ALONE = {"nominal_only": True, "max_sensitivity": None}
PROBLEMS: Mapping[str, Tune] = MappingProxyType(
    {
        "square, increment limited": Tune(
            parts=("square",), controller=STATE, max_rms_increment=0.18, **ALONE
        ),
        "circle, RMS control limited": Tune(
            parts=("circle",), controller=STATE, max_rms_control=2.224, **ALONE
        ),
        "circle, family, Ms limited": Tune(parts=("circle",)),
        "square, family, Ms limited": Tune(parts=("square",)),
        "flexible axis, cascade": Tune(
            parts=("task-a",),
            plant="flexible-axis",
            controller="cascade-feedforward",
            nominal_only=True,
        ),
        "circle, stage profile, Ms limited": Tune(
            parts=("circle",), free="alpha,beta,observer,stage", nominal_only=True
        ),
    }
)
LOST = 100.0  # merit of a point that diverges
DEAR = 10.0  # price of a limit's excess in the merit of a search without limits of its own


class Tried(eqx.Module):
    """One point without slopes.

    Attributes:
        merit: ln f + DEAR times the largest excess ln(value / limit); LOST where it diverges.
        objective: f; infinite beyond a limit.
    """

    merit: float
    objective: float


def problem_of(name: str) -> tuple[Problem, Weights]:
    """Problem and start of a name."""
    run = tuning_run(PROBLEMS[name])
    return run.problem, run.start


def measure_of(problem: Problem, start: Weights) -> Callable[[Float[np.ndarray, " d"]], Tried]:
    """Function from coordinates to merit and objective."""
    chart = Chart(problem.space, start)

    @jax.jit
    def runs(z: Float[Array, " d"]):
        weights = chart.weights(z)
        loops = problem.loops
        matrices = None if loops is None else loops.matrices(problem.build(weights), problem.plants)
        return problem.runs(weights), matrices

    @jax.jit
    def judged(outcome: Outcome):
        limits = jnp.max(problem.limits(outcome), initial=-jnp.inf)
        return problem.objective(outcome.metrics), limits, outcome.diverged

    def measure(z: Float[np.ndarray, " d"]) -> Tried:
        (metrics, use), matrices = jax.device_get(runs(jnp.asarray(z)))
        peaks = None
        if problem.loops is not None:
            slopes = jax.tree.map(lambda matrix: np.zeros((*matrix.shape, 0)), matrices)
            peaks = problem.loops.look(matrices, slopes)[0].peaks
        values, violation, lost = jax.device_get(judged(Outcome(metrics, peaks, use)))
        objective = objective_value(values)
        if lost or not np.isfinite(objective):
            return Tried(LOST, np.inf)
        merit = np.log(objective) + DEAR * max(0.0, float(violation))
        return Tried(float(merit), objective if violation <= FEASIBLE else np.inf)

    return measure
