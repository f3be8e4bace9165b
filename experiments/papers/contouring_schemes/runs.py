"""The runs behind the comparison of contouring schemes: the same tuning for every scheme, and its numbers on the true machines."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.papers.contouring_schemes.machine import (
    DT,
    held_out,
    references,
    smooth_family,
    training,
    true_family,
)
from jcontour.controller import Controller
from jcontour.controllers.contouring.command_shaping import CommandShaped
from jcontour.controllers.contouring.cross_coupled import (
    ConstantCoupling,
    CrossCoupled,
    CrossGains,
    VariableCoupling,
)
from jcontour.controllers.contouring.precompensation import Precompensated
from jcontour.controllers.contouring.task_frame import TaskFrame
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import follow
from jcontour.simulation.evaluation import one_by_one
from jcontour.simulation.metrics import Metrics, score_signals
from tuning.objectives import AtMost, mean_contour_error
from tuning.parameters import Fixed, Interval, Parameter, Positive
from tuning.problem import Problem
from tuning.tune import THOROUGH, Evaluated, Tuned, TuneState, advance, result

ARRIVED = 50e-6  # [m] from the end: there the contour counts as done
CURRENT, INCREMENT = (
    1.2,
    2.0,
    # limits, times what the thesis's gains with feedforward need of RMS current and of RMS increments
)
STRONG = 10.0  # times the small gains of a scheme where its cascade is not tuned yet
ONE_DESCENT = replace(THOROUGH, starts=1, scatter=0)  # ended by the budget


class Loops(NamedTuple):
    """Where the gains of the cascade start, and where they may go."""

    start: CascadeGains
    space: tuple[Parameter, ...]


# position and integral time are the thesis's, section 3.4; y has the same bandwidth as x; half of
# what the motion needs is fed forward
_FEEDBACK = {
    "position": 30.0 * np.ones(2),
    "velocity": np.array([55.67, 36.9]),
    "integral_time": 0.04 * np.ones(2),
}
_NOTHING = dict.fromkeys(("feedforward", "inertia", "viscous", "coulomb"), np.zeros(2))
_AHEAD = {
    "feedforward": 0.5 * np.ones(2),
    "inertia": np.array([0.25, 0.17]),
    "viscous": np.array([1.6, 1.25]),
    "coulomb": np.array([0.23, 0.21]),
}
FEEDBACK, FEEDFORWARD = "feedback alone", "with feedforward"
LOOPS = {
    FEEDBACK: Loops(CascadeGains(**_FEEDBACK, **_NOTHING), (*3 * (Positive(),), *4 * (Fixed(),))),
    FEEDFORWARD: Loops(
        CascadeGains(**_FEEDBACK, **_AHEAD),
        (*3 * (Positive(),), Interval(0.0, 1.5), *3 * (Positive(),)),
    ),
}


class Weights(NamedTuple):
    """Gains of the cascade, and those of the scheme around it."""

    cascade: CascadeGains
    scheme: tuple


class Scheme(NamedTuple):
    """How a scheme is built around a cascade, and where its own gains start: small, for a tuned cascade is not to be disturbed."""

    build: Callable[[Weights], Controller]
    start: tuple[float, ...]

    def around(self, gains: CascadeGains, strength: float = 1.0) -> Weights:
        """First weights, the scheme's own times a factor."""
        return Weights(gains, tuple(jnp.asarray(strength * value) for value in self.start))


def _cascade(weights: Weights) -> Cascade:
    return Cascade(weights.cascade, motors(2), DT)


CASCADE = "cascade"
SCHEMES = {
    CASCADE: Scheme(_cascade, ()),
    "cross-coupled, constant": Scheme(
        lambda w: CrossCoupled(_cascade(w), CrossGains(*w.scheme), ConstantCoupling()),
        (3.0, 3.0, 0.01),
    ),
    "cross-coupled, variable": Scheme(
        lambda w: CrossCoupled(_cascade(w), CrossGains(*w.scheme), VariableCoupling()),
        (3.0, 3.0, 0.01),
    ),
    "task frame": Scheme(lambda w: TaskFrame(_cascade(w)), ()),
    "pre-compensation": Scheme(lambda w: Precompensated(_cascade(w), *w.scheme), (1.0,)),
    "command shaping": Scheme(lambda w: CommandShaped(_cascade(w), *w.scheme), (0.1,)),
}


class Bench:
    """What every scheme is tuned with: the same machines, contours, limits and number of evaluations.

    Args:
        plants: of `MODEL_ERRORS`, as smooth twins.
        budget: evaluations of objective and gradient in one descent.
    """

    def __init__(self, plants: Sequence[str], budget: int):
        self.plants, self.references, self.budget = (
            smooth_family(plants),
            references(training()),
            budget,
        )
        start = scored(
            _cascade(Weights(LOOPS[FEEDFORWARD].start, ())), self.plants, self.references
        ).tool
        self.limits = AtMost(
            rms_control=CURRENT * float(jnp.max(start.rms_control)),
            rms_increment=INCREMENT * float(jnp.max(start.rms_increment)),
        )

    def tuned(self, scheme: Scheme, loops: Loops, starts: Sequence[Weights]) -> Tuned:
        """The best of one descent from each of these starts."""
        space = Weights(loops.space, tuple(Positive() for _ in scheme.start))  # type: ignore[arg-type]
        problem = Problem(
            scheme.build, self.plants, self.references, mean_contour_error, space, self.limits
        )
        history = [row for start in starts for row in self._descent(problem, start)]
        return result(problem, starts[0], TuneState(history))

    def _descent(self, problem: Problem, start: Weights) -> list[Evaluated]:
        state = TuneState()
        while not state.done and len(state.history) < self.budget:
            state = advance(problem, start, ONE_DESCENT, state)
        return state.history[: self.budget]


class Scores(NamedTuple):
    """Axes (contour, plant): metrics at the end effectors and at the motors, where the schemes measure, and when the tool is there [s]."""

    tool: Metrics
    motors: Metrics
    arrival: Float[Array, "c p"]


@eqx.filter_jit
def scored(controller: Controller, plants: Plant, references: Reference) -> Scores:
    """The controller on all machines along all contours."""

    def on_contour(reference: Reference):
        plan = controller.prepare(reference)

        def on_plant(plant: Plant):
            run = follow(plant, controller, plan, reference)
            tool, motor = (
                score_signals(signal, run.control, reference)
                for signal in (run.output, run.measurement[0])
            )
            return Scores(tool, motor, arrival(run.output, reference))

        return one_by_one(on_plant, plants)

    return one_by_one(on_contour, references)


def arrival(output: Float[Array, "T m"], reference: Reference) -> Float[Array, ""]:
    """When the tool has come to the end of a run from rest to rest, to stay [s]; not finite when it has not."""
    away = jnp.linalg.norm(output - reference.position[-1], axis=-1) > ARRIVED
    last = jnp.max(jnp.where(away, jnp.arange(reference.steps), -1))
    return jnp.where(away[-1], jnp.inf, (last + 1) * reference.dt)


def rows(
    name: str, loops: str, controller: Controller, plants: Sequence[str]
) -> list[dict[str, Any]]:
    """The controller on these true machines along every contour."""
    contours = {**training(), **held_out()}
    scores = scored(controller, true_family(plants), references(contours))
    return [
        {
            "scheme": name,
            "loops": loops,
            "contour": contour,
            "training": i < len(training()),
            "plant": plant,
            **_numbers(scores.tool, i, j),
            "motor_um": 1e6 * float(scores.motors.rms_contour_error[i, j]),
            "time_s": float(scores.arrival[i, j]),
        }
        for i, contour in enumerate(contours)
        for j, plant in enumerate(plants)
    ]


def _numbers(metrics: Metrics, i: int, j: int) -> dict[str, Any]:
    return {
        "contour_um": 1e6 * float(metrics.rms_contour_error[i, j]),
        "peak_um": 1e6 * float(metrics.peak_contour_error[i, j]),
        "tracking_um": 1e6 * float(metrics.rms_tracking_error[i, j]),
        "current_a": float(metrics.rms_control[i, j]),
        "increment_a": float(metrics.rms_increment[i, j]),
        "diverged": bool(metrics.diverged[i, j]),
    }
