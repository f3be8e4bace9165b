"""The runs behind Yuan's tables of chapter 3: every controller of flexible axes on tasks A and B, as it starts and as it is tuned."""

import time
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from experiments.catalogue.choices import design_for, job_named
from experiments.catalogue.controllers import CONTROLLERS
from experiments.jobs.job import Pace
from experiments.jobs.replays import Scenarios, replay
from experiments.machines.flexible_axis import EFFORT, FlexibleMachine, thesis_machine
from experiments.options import Simulate, Tune
from experiments.runs.tuning import start_metrics, tuning_run
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.flexible_axis.axis import FlexibleAxis, SmoothFlexibleAxis
from jcontour.simulation.closed_loop import Rollout, simulate
from jcontour.simulation.evaluation import stack_references
from tuning.tune import tune

TASKS = {"A": "task-a", "B": "task-b"}  # point to point, sinusoid
BASELINE = "cascade"  # the thesis's P-PI with its gains
SHARPNESSES = (
    100.0,
    200.0,
    500.0,
    1e3,
    2e3,
    5e3,
    1e4,
)  # [s/m]; the default, 1e3, turns the friction within 1 mm/s
TIMINGS = 20  # the shortest of them counts, because other work only adds


class Signals(NamedTuple):
    """Motor, end effector and reference [m], and current [A], of one run (T,)."""

    motor: np.ndarray
    tool: np.ndarray
    wanted: np.ndarray
    current: np.ndarray


class Bench:
    """The thesis's axis and its two tasks; the controllers are fed the exact position and speed of the motor, as its simulations are."""

    def __init__(self):
        self.machine: FlexibleMachine = thesis_machine()
        self.true = FlexibleAxis(self.machine.parameters, self.machine.model.dt)
        self.jobs = [job_named(name, Pace(self.machine, None, None)) for name in TASKS.values()]

    def controllers(self) -> list[str]:
        """Names of all that suit the axis."""
        return [name for name, entry in CONTROLLERS.items() if entry.on == self.machine.name]

    def design(self, name: str):
        """A controller with its own first gains: the thesis's where it gives them."""
        return design_for(self.machine, Simulate(controller=name))

    def scenarios(self, preview: int) -> Scenarios:
        """Both tasks on the whole true family, behind encoders that count."""
        return Scenarios.of(self.jobs, [True, False], self.machine, "outputs", preview)

    def references(self, preview: int) -> Reference:
        """Both tasks, stacked."""
        return stack_references(
            [job.reference(self.machine.model.dt, preview) for job in self.jobs]
        )

    def signals(self, controller: Controller, plant: Plant | None = None) -> dict[str, Signals]:
        """Every task on the true axis, or on another plant."""
        references = self.references(controller.preview)
        run = _both(self.true if plant is None else plant, controller, references)
        found = {}
        for k, (task, job) in enumerate(zip(TASKS, self.jobs, strict=True)):
            rows = (run.measurement[0], run.output, references.position, run.control)
            found[task] = Signals(*(np.asarray(row)[k, : job.samples, 0] for row in rows))
        return found

    def time_per_sample(self, controller: Controller) -> float:
        """Seconds of computing per sample of the controller alone, fed what it would measure on an axis that follows task A exactly."""
        reference = self.jobs[0].reference(self.machine.model.dt, controller.preview)
        position = reference.position[: reference.steps]
        speed = np.gradient(np.asarray(position), reference.dt, axis=0)
        rows = (controller.prepare(reference), (position, jnp.asarray(speed)))
        memory = controller.initial_memory(reference)
        _alone(controller, memory, rows).block_until_ready()  # compiled
        return (
            min(_timed(lambda: _alone(controller, memory, rows)) for _ in range(TIMINGS))
            / reference.steps
        )


def metrics(signals: Signals) -> dict[str, float]:
    """Columns of Tables 3.1 and 3.2 [mm, A], and RMS and peak of the current; the last input acts on no sample and is left out."""
    motor, tool, deformation = (
        1e3 * np.abs(row)
        for row in (
            signals.motor - signals.wanted,
            signals.tool - signals.wanted,
            signals.motor - signals.tool,
        )
    )
    current = np.abs(signals.current[:-1])
    return {
        "em_max": motor.max(),
        "em_mean": motor.mean(),
        "ee_max": tool.max(),
        "ee_mean": tool.mean(),
        "def_max": deformation.max(),
        "u_mean": current.mean(),
        "u_rms": float(np.sqrt(np.mean(current**2))),
        "u_max": current.max(),
    }


def gap_curve(bench: Bench) -> list[dict[str, float]]:
    """RMS end-effector error of the smooth twin against the true axis under the thesis's cascade, over the sharpness."""
    design = bench.design(BASELINE)
    controller = design.build(design.start)
    true, rows = _rms(bench.signals(controller)), []
    for sharpness in SHARPNESSES:
        smooth = _rms(
            bench.signals(
                controller,
                SmoothFlexibleAxis(bench.machine.parameters, bench.machine.model.dt, sharpness),
            )
        )
        rows.append(
            {"sharpness": sharpness, **{task: abs(smooth[task] / true[task] - 1) for task in TASKS}}
        )
    return rows


def tuned_weights(name: str) -> dict[str, Any]:
    """Gains from the smooth family on task A, within 1.2 times the RMS current that the thesis's cascade needs there.

    Raises:
        ValueError: every start diverges.
    """
    run = tuning_run(
        Tune(plant=CONTROLLERS[name].on, controller=name, max_rms_control=_allowed_current())
    )
    return tune(run.problem, run.start, run.settings).weights


def on_the_family(bench: Bench, controller: Controller) -> list[dict[str, Any]]:
    """Mean end-effector error [mm] and RMS current [A] of every task on every true member, and whether it diverges."""
    scenarios = bench.scenarios(controller.preview)
    found, rows = replay(controller, scenarios), []
    for k, (task, job) in enumerate(zip(TASKS, bench.jobs, strict=True)):
        wanted = np.asarray(scenarios.references.position)[k, : job.samples]
        for p, plant in enumerate(scenarios.plants):
            error = 1e3 * np.abs(found.output[k, p, : job.samples] - wanted)
            current, lost = (
                found.control[k, p, : job.samples - 1],
                bool(found.metrics.diverged[k, p]),
            )
            rows.append(
                {
                    "task": task,
                    "plant": plant,
                    "diverged": lost,
                    "ee_mean": None if lost else float(error.mean()),
                    "u_rms": None if lost else float(np.sqrt(np.mean(current**2))),
                }
            )
    return rows


@cache
def _allowed_current() -> float:
    """[A] on the smooth family."""
    baseline = tuning_run(Tune(plant=CONTROLLERS[BASELINE].on, controller=BASELINE))
    return EFFORT * float(np.max(start_metrics(baseline.problem, baseline.start).rms_control))


def _rms(found: dict[str, Signals]) -> dict[str, float]:
    return {
        task: float(np.sqrt(np.mean((one.tool - one.wanted) ** 2))) for task, one in found.items()
    }


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
