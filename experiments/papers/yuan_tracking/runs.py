"""Runs behind Yuan's tables of chapter 3: the controllers of flexible axes on tasks A and B."""

import time
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from experiments.papers.yuan_tracking.result import FamilyRow, GapRow, Signals, TaskMetrics
from jcontour.app.catalogue.choices import design_for, first_machine, job_named
from jcontour.app.catalogue.controllers import CONTROLLERS, design_class
from jcontour.app.designs.flexible_axis import AxisDesign
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.job import Pace
from jcontour.app.jobs.replays import Scenarios, replay
from jcontour.app.machines.flexible_axis import EFFORT, FlexibleMachine, thesis_machine
from jcontour.app.runs.tuning.limits import start_metrics
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.flexible_axis.axis import FlexibleAxis, SmoothFlexibleAxis
from jcontour.simulation.closed_loop import Rollout, simulate
from jcontour.simulation.evaluation import stack_references
from tuning.tuner import tune

JOBS = {"A": "task-a", "B": "task-b"}  # in the catalogue
BASELINE = "cascade"  # the thesis's P-PI with its gains
# [s/m]; the default, 1e3, turns the friction within 1 mm/s
SHARPNESSES = (100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4)
TIMINGS = 20  # the shortest of them counts, because other work only adds


class Setup:
    """The thesis's axis and its two tasks.

    The controllers are fed the exact position and speed of the motor, as in its simulations.
    """

    def __init__(self):
        self.machine: FlexibleMachine = thesis_machine()
        self.true = FlexibleAxis(self.machine.parameters, self.machine.model.dt)
        pace = Pace(self.machine, None, None)
        self.jobs = [job_named(name, pace) for name in JOBS.values()]

    def controllers(self) -> list[str]:
        """Names of all controllers that suit the axis."""
        return [name for name in CONTROLLERS if design_class(name).needs == AxisDesign.needs]

    def design(self, name: str):
        """Design of a controller with its first gains: the thesis's where it gives them."""
        return design_for(self.machine, Simulate(controller=name))

    def scenarios(self, preview: int) -> Scenarios:
        """Both tasks on the whole true family, behind encoders that count."""
        return Scenarios.of(self.jobs, [True, False], self.machine, "outputs", preview)

    def references(self, preview: int) -> Reference:
        """References of both tasks, stacked."""
        return stack_references(
            [job.reference(self.machine.model.dt, preview) for job in self.jobs]
        )

    def signals(self, controller: Controller, plant: Plant | None = None) -> dict[str, Signals]:
        """Signals of every task on the true axis, or on another plant."""
        references = self.references(controller.preview)
        run = _both(self.true if plant is None else plant, controller, references)
        found = {}
        rows = (run.measurement[0], run.output, references.position, run.control)
        for k, (task, job) in enumerate(zip(JOBS, self.jobs, strict=True)):
            found[task] = Signals(*(np.asarray(row)[k, : job.samples, 0] for row in rows))
        return found

    def time_per_sample(self, controller: Controller) -> float:
        """Computing time of the controller alone [s].

        It is fed what it would measure on an axis that follows task A exactly.
        """
        reference = self.jobs[0].reference(self.machine.model.dt, controller.preview)
        position = reference.position[: reference.steps]
        speed = np.gradient(np.asarray(position), reference.dt, axis=0)
        rows = (controller.prepare(reference), (position, jnp.asarray(speed)))
        memory = controller.initial_memory(reference)
        _alone(controller, memory, rows).block_until_ready()  # compiled
        times = [_timed(lambda: _alone(controller, memory, rows)) for _ in range(TIMINGS)]
        return min(times) / reference.steps


def metrics(signals: Signals) -> TaskMetrics:
    """Columns of Tables 3.1 and 3.2 [mm, A], and RMS and peak of the current.

    The last input acts on no sample and is left out.
    """
    motor = 1e3 * np.abs(signals.motor - signals.wanted)
    tool = 1e3 * np.abs(signals.tool - signals.wanted)
    deformation = 1e3 * np.abs(signals.motor - signals.tool)
    current = np.abs(signals.current[:-1])
    return TaskMetrics(
        em_max=float(motor.max()),
        em_mean=float(motor.mean()),
        ee_max=float(tool.max()),
        ee_mean=float(tool.mean()),
        def_max=float(deformation.max()),
        u_mean=float(current.mean()),
        u_rms=float(np.sqrt(np.mean(current**2))),
        u_max=float(current.max()),
    )


def gap_curve(setup: Setup) -> tuple[GapRow, ...]:
    """Smooth twin against the true axis under the thesis's cascade, over the sharpness."""
    design = setup.design(BASELINE)
    controller = design.build(design.start)
    parameters, dt = setup.machine.parameters, setup.machine.model.dt
    true = _rms(setup.signals(controller))
    rows = []
    for sharpness in SHARPNESSES:
        plant = SmoothFlexibleAxis(parameters, dt, sharpness)
        smooth = _rms(setup.signals(controller, plant))
        gap = {task: abs(smooth[task] / true[task] - 1) for task in JOBS}
        rows.append(GapRow(sharpness, **gap))
    return tuple(rows)


def tuned_weights(name: str) -> dict[str, Any]:
    """Gains tuned on the smooth family on task A.

    They may need 1.2 times the RMS current of the thesis's cascade there.

    Raises:
        ValueError: every start diverges.
    """
    run = tuning_run(
        Tune(plant=first_machine(name), controller=name, max_rms_control=_allowed_current())
    )
    return tune(run.problem, run.start, run.settings).weights


def on_the_family(setup: Setup, controller: Controller) -> tuple[FamilyRow, ...]:
    """Every task on every true member of the family."""
    scenarios = setup.scenarios(controller.preview)
    found, rows = replay(controller, scenarios), []
    for k, (task, job) in enumerate(zip(JOBS, setup.jobs, strict=True)):
        wanted = np.asarray(scenarios.references.position)[k, : job.samples]
        for p, plant in enumerate(scenarios.plants):
            if found.metrics.diverged[k, p]:
                rows.append(FamilyRow(task, plant, True, None, None))
                continue
            error = 1e3 * np.abs(found.output[k, p, : job.samples] - wanted)
            current = found.control[k, p, : job.samples - 1]
            rms = float(np.sqrt(np.mean(current**2)))
            rows.append(FamilyRow(task, plant, False, float(error.mean()), rms))
    return tuple(rows)


@cache
def _allowed_current() -> float:
    """Largest RMS current that tuned gains may need on the smooth family [A]."""
    baseline = tuning_run(Tune(plant=first_machine(BASELINE), controller=BASELINE))
    return EFFORT * float(np.max(start_metrics(baseline.problem, baseline.start).rms_control))


def _rms(by_task: Mapping[str, Signals]) -> dict[str, float]:
    """RMS end-effector error of every task [m]."""
    squares = {task: np.mean((one.tool - one.wanted) ** 2) for task, one in by_task.items()}
    return {task: float(np.sqrt(square)) for task, square in squares.items()}


@eqx.filter_jit
def _both(plant: Plant, controller: Controller, references: Reference) -> Rollout:
    return jax.vmap(lambda reference: simulate(plant, controller, reference))(references)


@eqx.filter_jit
def _alone(controller: Controller, memory: Any, rows: tuple[Any, Any]) -> jax.Array:
    """Controls for given plans and measurements."""
    return jax.lax.scan(lambda memory, row: controller.step(memory, *row), memory, rows)[1]


def _timed(work: Callable[[], jax.Array]) -> float:
    began = time.perf_counter()
    work().block_until_ready()
    return time.perf_counter() - began
