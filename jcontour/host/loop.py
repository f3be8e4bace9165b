"""The closed loop on the host: a Python loop whose controller may solve a QP at every step.

u(k), w(k+1) = controller(w(k), plan(k), measure(x(k)));   x(k+1) = plant(x(k), u(k))

The same loop as `simulate` and the same `Rollout`; it drives traceable controllers too, in one
compiled call a step.
"""

import abc
import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant, State
from jcontour.qp.problem import Unsolved
from jcontour.simulation.closed_loop import Rollout, check_run, prepared, start_state

Fallback = Literal["hold", "soft"]


class StepReport(NamedTuple):
    """What a controller tells of the step it has just made.

    Attributes:
        active: how many limits were active.
        residual: the largest scaled KKT residual of the QP.
        iterations: of the solver.
        slack: the largest violation of a soft limit, in that limit's unit.
    """

    active: int = 0
    residual: float = 0.0
    iterations: int = 0
    slack: float = 0.0


class LoopReport(NamedTuple):
    """The step reports of a run, one row per step, and where the fallback had to act."""

    active: Int[np.ndarray, " T"]
    residual: Float[np.ndarray, " T"]
    iterations: Int[np.ndarray, " T"]
    slack: Float[np.ndarray, " T"]
    fallback: Bool[np.ndarray, " T"]

    @property
    def fallbacks(self) -> int:
        """How many steps were the fallback's."""
        return int(self.fallback.sum())

    @property
    def active_fraction(self) -> float:
        """Fraction of the steps in which a limit was active."""
        return float(np.mean(self.active > 0)) if self.active.size else 0.0

    @property
    def worst_residual(self) -> float:
        """The largest residual of any step that was solved."""
        return float(self.residual.max(initial=0.0))


class Run(NamedTuple):
    """A run on the host and what its controller told of it."""

    rollout: Rollout
    report: LoopReport


class HostController(abc.ABC):
    """A sampled controller in plain Python: measurements, plans, memories and controls are NumPy arrays, or pytrees of them."""

    preview: int

    @abc.abstractmethod
    def prepare(self, reference: Reference) -> Any:
        """Everything that depends on the future only: a pytree of NumPy arrays with a leading axis of T steps, or None."""

    @abc.abstractmethod
    def initial_memory(self, reference: Reference) -> Any:
        """Memory before the first step: a pytree of NumPy arrays and numbers whose shapes never change; each step makes a new one."""

    @abc.abstractmethod
    def step(self, memory: Any, plan: Any, measurement: Any) -> tuple[Any, Float[np.ndarray, " p"]]:
        """Next memory and the control, from one row of the plan and what the sensors give now.

        Raises:
            Unsolved: the QP of this step has no answer.
        """

    def soft_step(
        self, memory: Any, plan: Any, measurement: Any
    ) -> tuple[Any, Float[np.ndarray, " p"]] | None:
        """The step again with softened limits, for the fallback "soft"; None where the controller has no such thing."""
        return None

    def held(self, memory: Any, measurement: Any, control: Float[np.ndarray, " p"]) -> Any:
        """Memory after a step in which the fallback repeated the last control."""
        return memory

    def finished(self, memory: Any) -> bool:
        """Whether the run is over: for controllers that choose their own speed."""
        return False

    def report(self) -> StepReport:
        """Of the step made last."""
        return StepReport()


class Stopped(RuntimeError):
    """A run that ended early because a step has no answer.

    Attributes:
        step: the step that failed.
        run: what was simulated before it, k = 0..step-1; `final_state` is the state the failed step
            began in.
        cause: the `Unsolved`.
    """

    def __init__(self, step: int, run: Run, cause: Unsolved):
        self.step, self.run, self.cause = step, run, cause
        super().__init__(str(cause))

    @property
    def rollout(self) -> Rollout:
        """The part of the run that was simulated."""
        return self.run.rollout


def loop(
    plant: Plant,
    controller: Controller | HostController,
    reference: Reference,
    state: State | None = None,
    fallback: Fallback | None = None,
) -> Rollout:
    """The rollout of `reported_loop`; a fallback that had to act is warned of.

    Raises:
        ValueError, Stopped: as `reported_loop`.
    """
    run = reported_loop(plant, controller, reference, state, fallback)
    if run.report.fallbacks:
        first = int(np.argmax(run.report.fallback))
        warnings.warn(
            f"fallback {fallback!r} acted in {run.report.fallbacks} of {run.report.fallback.size} steps, first in step {first}",
            stacklevel=2,
        )
    return run.rollout


def reported_loop(
    plant: Plant,
    controller: Controller | HostController,
    reference: Reference,
    state: State | None = None,
    fallback: Fallback | None = None,
) -> Run:
    """Run `controller` on `plant` along `reference`, for its T steps or until the controller has finished.

    Args:
        plant: any.
        controller: traceable, or on the host.
        reference: where the tool should be.
        state: the first one; where the reference begins when not given.
        fallback: what a step without an answer does: "hold" repeats the last control, "soft" solves
            it again with softened limits (and holds where that fails too); None stops the run.

    Raises:
        ValueError: preview or sample period do not fit, or there is no such fallback.
        Stopped: a step had no answer and no fallback.
    """
    if fallback not in (None, "hold", "soft"):
        raise ValueError(f"fallback: there are hold and soft, received {fallback!r}")
    check_run(plant, controller, reference)  # type: ignore  # reads `preview` alone
    if isinstance(controller, Controller):
        return _traced(plant, controller, reference, state)
    return _hosted(plant, controller, reference, state, fallback)


class _Rows:
    """The rows of a rollout and of its report while they come in."""

    def __init__(self):
        self.rows, self.reports, self.fallback = [], [], []

    def add(self, state, output, measurement, control, memory, report, fallback):
        self.rows.append((state, output, measurement, control, memory))
        self.reports.append(report)
        self.fallback.append(fallback)

    def run(self, state, memory) -> Run:
        """Everything up to here; an empty run has no rows to stack, its signals are None."""
        columns = [_stacked([row[i] for row in self.rows]) for i in range(5)]
        told = [np.array(column) for column in zip(*self.reports, strict=True)] or [np.zeros(0)] * 4
        return Run(
            Rollout(*columns, state, memory), LoopReport(*told, np.array(self.fallback, bool))
        )


def _traced(plant: Plant, controller: Controller, reference: Reference, state) -> Run:
    """One compiled call a step: measure, control, advance."""
    state = start_state(plant, reference) if state is None else state
    memory, plan = controller.initial_memory(reference), _Plan(prepared(controller, reference))
    numbers, step = _with_numbers(_whole_step, (plant, controller))
    rows = _Rows()
    for k in range(reference.steps):
        before = state, memory
        state, memory, output, measurement, control = step(numbers, *before, plan.row(k))
        rows.add(before[0], output, measurement, control, before[1], StepReport(), False)
    return rows.run(state, memory)


def _hosted(plant: Plant, controller: HostController, reference: Reference, state, fallback) -> Run:
    """One compiled call a step: advance, and see; the controller in between is the host's."""
    state = start_state(plant, reference) if state is None else state
    memory, plan = controller.initial_memory(reference), _Plan(controller.prepare(reference))
    numbers, see = _with_numbers(_seen, (plant,))
    _, advance = _with_numbers(_advanced, (plant,))
    output, measurement = see(numbers, state)
    rows, control = _Rows(), None
    for k in range(reference.steps):
        if controller.finished(memory):
            break
        sensed, fell_back = jax.tree.map(np.asarray, measurement), False
        try:
            next_memory, control = controller.step(memory, plan.row(k), sensed)
        except Unsolved as cause:
            cause.step = k
            answer = _fallen_back(fallback, controller, memory, plan.row(k), sensed, control)
            if answer is None:
                raise Stopped(k, rows.run(state, memory), cause) from cause
            (next_memory, control), fell_back = answer, True
        rows.add(state, output, measurement, control, memory, controller.report(), fell_back)
        state, output, measurement = advance(numbers, state, control)
        memory = next_memory
    return rows.run(state, memory)


def _fallen_back(fallback, controller: HostController, memory, plan, measurement, control):
    """(memory, control) of the fallback, None when there is none (nothing to hold before the first control)."""
    if fallback == "soft":
        try:
            answer = controller.soft_step(memory, plan, measurement)
        except Unsolved:
            answer = None
        if answer is not None:
            return answer
    if fallback is None or control is None:
        return None
    return controller.held(memory, measurement, control), control


class _Plan:
    """Rows of a plan, cheaper to reach than by mapping over its tree."""

    def __init__(self, plan):
        leaves, self._tree = jax.tree.flatten(plan)
        self._leaves = [np.asarray(leaf) for leaf in leaves]

    def row(self, k: int):
        return self._tree.unflatten([leaf[k] for leaf in self._leaves])


def _whole_step(plant: Plant, controller: Controller, state, memory, plan):
    measurement = plant.measure(state)
    next_memory, control = controller.step(memory, plan, measurement)
    return plant.step(state, control), next_memory, plant.output(state), measurement, control


def _seen(plant: Plant, state):
    return plant.output(state), plant.measure(state)


def _advanced(plant: Plant, state, control):
    after = plant.step(state, control)
    return after, plant.output(after), plant.measure(after)


def _with_numbers(function: Callable, modules: tuple) -> tuple[list, Callable]:
    """The modules' numbers, and the function of (numbers, ...) compiled once for all modules of the same structure."""
    arrays, static = eqx.partition(modules, eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)
    return leaves, _compiled(function, tree, static)


@lru_cache(maxsize=64)
def _compiled(function: Callable, tree, static) -> Callable:
    @jax.jit
    def call(leaves, *arguments):
        return function(*eqx.combine(jax.tree.unflatten(tree, leaves), static), *arguments)

    return call


def _stacked(rows: list):
    """Pytrees stacked on a new leading axis; None when there are none."""
    if not rows:
        return None
    tree = jax.tree.structure(rows[0])
    columns = zip(*(jax.tree.leaves(row) for row in rows), strict=True)
    return tree.unflatten(
        [jnp.asarray(np.stack([np.asarray(value) for value in column])) for column in columns]
    )
