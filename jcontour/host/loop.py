"""The closed loop on the host: a Python loop whose controller may solve a QP at every step.

u(k), w(k+1) = controller(w(k), plan(k), measure(x(k)));   x(k+1) = plant(x(k), u(k))

The same loop as `simulate` and the same `Rollout`.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour._arrays import placed
from jcontour.host.controller import HostController, Stepped, StepReport
from jcontour.motion.references import Reference
from jcontour.plant import Plant, State
from jcontour.qp.problem import Unsolved
from jcontour.simulation.closed_loop import Rollout, check_run, start_state

Fallback = Literal["hold", "soft"]
FALLBACKS = (None, "hold", "soft")


class LoopReport(NamedTuple):
    """The step reports of a run, one row per step, and where the fallback had to act."""

    active: Int[np.ndarray, " T"]
    residual: Float[np.ndarray, " T"]
    iterations: Int[np.ndarray, " T"]
    slack: Float[np.ndarray, " T"]
    fallback: Bool[np.ndarray, " T"]
    acting: Int[np.ndarray, " T"]

    @property
    def fallbacks(self) -> int:
        """Number of steps that the fallback made."""
        return int(self.fallback.sum())

    @property
    def active_fraction(self) -> float:
        """Fraction of the steps in which a limit was active."""
        return float(np.mean(self.active > 0)) if self.active.size else 0.0

    @property
    def acting_fraction(self) -> float:
        """Fraction of the steps whose own control was kept by a limit."""
        return float(np.mean(self.acting > 0)) if self.acting.size else 0.0

    @property
    def worst_residual(self) -> float:
        """The largest residual of any step that was solved."""
        return float(self.residual.max(initial=0.0))


class HostRun(NamedTuple):
    """A run on the host and the report of its steps."""

    rollout: Rollout
    report: LoopReport


class Stopped(RuntimeError):
    """A run that ended early because a step has no answer.

    Attributes:
        step: the step that failed.
        run: what was simulated before it, k = 0..step-1; `final_state` is the state the failed step
            began in.
        cause: the `Unsolved`.
    """

    def __init__(self, step: int, run: HostRun, cause: Unsolved):
        self.step, self.run, self.cause = step, run, cause
        super().__init__(str(cause))


def reported_loop(
    plant: Plant,
    controller: HostController,
    reference: Reference,
    state: State | None = None,
    fallback: Fallback | None = None,
) -> HostRun:
    """Run `controller` on `plant` along `reference`, for T steps or until it has finished.

    Args:
        plant: any.
        controller: on the host; `simulate` runs those of JAX.
        reference: where the tool should be.
        state: the first one; where the reference begins when not given.
        fallback: what a step without an answer does: "hold" repeats the last control, "soft" solves
            it again with softened limits (and holds where that fails too); None stops the run.

    Raises:
        ValueError: preview or sample period do not fit, or there is no such fallback.
        Stopped: a step had no answer and no fallback.
    """
    if fallback not in FALLBACKS:
        raise ValueError(f"fallback: there are hold and soft, received {fallback!r}")
    check_run(plant, controller, reference)
    state = start_state(plant, reference) if state is None else state
    # One compiled call a step: advance, and see; the controller in between is the host's
    memory = controller.initial_memory(reference)
    plan = _Plan(controller.prepare(reference))
    numbers, see = _with_numbers(_seen, (plant,))
    _, advance = _with_numbers(_advanced, (plant,))
    output, measurement = see(numbers, state)
    rows, control = _Rows(output.size), None
    for k in range(reference.steps):
        if controller.finished(memory):
            break
        sensed = jax.tree.map(np.asarray, measurement)
        failure = None
        try:
            answer = controller.step(memory, plan.row(k), sensed)
        except Unsolved as cause:
            cause.step, failure = k, cause
            answer = _fallen_back(fallback, controller, memory, plan.row(k), sensed, control)
        if answer is None:
            assert failure is not None
            raise Stopped(k, rows.run(state, memory), failure) from failure
        next_memory, control, report = answer
        rows.add((state, output, measurement, control, memory), report, failure is not None)
        state, output, measurement = advance(numbers, state, control)
        memory = next_memory
    return rows.run(state, memory)


class _Rows:
    """The rows of a rollout and of its report while they come in."""

    def __init__(self, axes: int):
        self.axes = axes
        self.signals: list[tuple] = []
        self.reports: list[StepReport] = []
        self.fallback: list[bool] = []

    def add(self, signals: tuple, report: StepReport, fallback: bool) -> None:
        """One step: (state, output, measurement, control, memory), its report, who made it."""
        self.signals.append(signals)
        self.reports.append(report)
        self.fallback.append(fallback)

    def run(self, state: Any, memory: Any) -> HostRun:
        """Everything up to here.

        Before the first control its size is not known: an empty run has controls of shape (0, 0),
        and None for state, measurement and memory.
        """
        if self.signals:
            # pytrees stacked on a new leading axis
            tree = jax.tree.structure(self.signals[0])
            leaves = zip(*map(jax.tree.leaves, self.signals), strict=True)
            stacked = [placed(np.stack([np.asarray(one) for one in leaf])) for leaf in leaves]
            columns = tree.unflatten(stacked)
        else:
            columns = [None, jnp.zeros((0, self.axes)), None, jnp.zeros((0, 0)), None]
        report = LoopReport(
            np.array([one.active for one in self.reports], int),
            np.array([one.residual for one in self.reports], float),
            np.array([one.iterations for one in self.reports], int),
            np.array([one.slack for one in self.reports], float),
            np.array(self.fallback, bool),
            np.array([one.acting for one in self.reports], int),
        )
        return HostRun(Rollout(*columns, state, memory), report)


def _fallen_back(
    fallback: Fallback | None,
    controller: HostController,
    memory: Any,
    plan: Any,
    measurement: Any,
    control: Float[np.ndarray, " p"] | None,
) -> Stepped | None:
    """Answer of the fallback; None without one, or with nothing to hold yet."""
    if fallback == "soft":
        try:
            answer = controller.soft_step(memory, plan, measurement)
        except Unsolved:
            answer = None
        if answer is not None:
            return answer
    if fallback is None or control is None:
        return None
    return controller.held(memory, measurement, control), control, StepReport()


class _Plan:
    """Rows of a plan, cheaper to reach than by mapping over its tree."""

    def __init__(self, plan: Any):
        leaves, self._tree = jax.tree.flatten(plan)
        self._leaves = [np.asarray(leaf) for leaf in leaves]

    def row(self, k: int) -> Any:
        return self._tree.unflatten([leaf[k] for leaf in self._leaves])


def _seen(plant: Plant, state):
    return plant.output(state), plant.measure(state)


def _advanced(plant: Plant, state, control):
    after = plant.step(state, control)
    return after, plant.output(after), plant.measure(after)


def _with_numbers(function: Callable, modules: tuple) -> tuple[list, Callable]:
    """The modules' numbers, and the function of (numbers, ...) that they are given to."""
    arrays, static = eqx.partition(modules, eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)
    return leaves, _compiled(function, tree, static)


@lru_cache(maxsize=64)
def _compiled(function: Callable, tree: Any, static: Any) -> Callable:
    @jax.jit
    def call(leaves, *arguments):
        modules = eqx.combine(jax.tree.unflatten(tree, leaves), static)
        return function(*modules, *arguments)

    return call
