"""Yuan 2020, chapter 3: tracking with a flexible axis, Tables 3.1 and 3.2, Figs 3.8 to 3.11.

Every controller of flexible axes is tuned and ranked as well. The thesis's tables were measured on
its test bench: our simulation of its model stands beside them and is not fitted to them.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from experiments.papers.yuan_tracking.beam import BeamStudy, beam_study
from jcontour.app.catalogue.choices import design_for, first_machine, job_named
from jcontour.app.catalogue.entries import CONTROLLERS, design_class
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

SOURCE = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020), chapter 3 "
    "(performance of tracking control)"
)
JOBS = {"A": "task-a", "B": "task-b"}  # in the catalogue
BASELINE = "cascade"  # the thesis's P-PI with its gains
# [s/m]; the default, 1e3, turns the friction within 1 mm/s
SHARPNESSES = (100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4)
TASKS = tuple(JOBS)  # point to point, to and fro along a cosine
KEPT_PERIOD = 5e-3  # [s] between the samples of a signal: a fourteenth of the link's period
DRAWN = (BASELINE, "cascade-notch", "cascade-leso-exact")  # Figs 3.8 to 3.11


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce yuan-tracking`."""

    quick: bool = False
    """Finish within a minute: nothing is tuned, the ranking is that of the first gains."""
    tuned: tuple[str, ...] = ()
    """Controllers that are tuned, by their names in `jcontour list`; all when none is given."""


@dataclass(frozen=True)
class Columns:
    """Columns of Tables 3.1 and 3.2: errors and deformation [mm], mean current [A]."""

    em_max: float  # motor
    em_mean: float
    ee_max: float  # end effector
    ee_mean: float
    def_max: float  # motor against end effector
    u_mean: float


@dataclass(frozen=True)
class TaskMetrics(Columns):
    """Columns of the thesis, and RMS and peak of the current [A]."""

    u_rms: float
    u_max: float


@dataclass(frozen=True)
class FamilyRow:
    """One task on one machine of the family; infinite where the run diverges."""

    task: str
    plant: str
    diverged: bool
    ee_mean: float  # [mm]
    u_rms: float  # [A]


@dataclass(frozen=True)
class RankingRow:
    """A controller with its first gains ("start") or with tuned ones ("tuned")."""

    controller: str
    gains: str
    weights: dict[str, Any]
    A: TaskMetrics
    B: TaskMetrics
    family: tuple[FamilyRow, ...]  # of tuned controllers, and of the one they are compared with

    def on(self, task: str) -> TaskMetrics:
        """Metrics of one task."""
        return getattr(self, task)

    @property
    def error(self) -> float:
        """Mean error of the end effector, both tasks together [mm]."""
        return self.A.ee_mean + self.B.ee_mean


@dataclass(frozen=True)
class Signals:
    """Motor, end effector and reference [m], and current [A], of one run."""

    motor: Float[np.ndarray, " T"]
    tool: Float[np.ndarray, " T"]
    wanted: Float[np.ndarray, " T"]
    current: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class GapRow:
    """Relative gap of the smooth twin in RMS end-effector error, at one sharpness [s/m]."""

    sharpness: float
    A: float
    B: float


@dataclass(frozen=True)
class Result:
    """All controllers on both tasks, signals of some, and the gap of the smooth twin."""

    ranking: tuple[RankingRow, ...]
    signals: dict[str, dict[str, Signals]]  # by controller and task, every `KEPT_PERIOD`
    gap: tuple[GapRow, ...]  # sharpness ascending
    beam: BeamStudy

    def row(self, controller: str, gains: str = "start") -> RankingRow:
        """The one row of a controller."""
        wanted = (controller, gains)
        return next(row for row in self.ranking if (row.controller, row.gains) == wanted)


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


def run(settings: Settings) -> Result:
    """Simulate everything.

    Raises:
        ValueError: no such controller of flexible axes.
    """
    setup = Setup()
    known = setup.controllers()
    for name in settings.tuned:
        if name not in known:
            raise ValueError(
                f"tuned: there is no controller {name!r} of flexible axes; "
                f"give some of {', '.join(known)}"
            )
    to_tune = () if settings.quick else settings.tuned or tuple(known)

    def tracked(name: str) -> tuple[list[RankingRow], dict[str, Signals]]:
        """Rows of the first gains and of tuned ones, and the signals of the first gains."""
        design, rows, first = setup.design(name), [], {}
        gains = {"start": design.start}
        if name in to_tune:
            gains["tuned"] = tuned_weights(name)
        for which, weights in gains.items():
            controller = design.build(weights)
            compared = name in to_tune or (bool(to_tune) and name == BASELINE)
            signals = setup.signals(controller)
            first = first or signals
            row = RankingRow(
                controller=name,
                gains=which,
                weights={key: np.asarray(value).tolist() for key, value in weights.items()},
                A=metrics(signals["A"]),
                B=metrics(signals["B"]),
                family=on_the_family(setup, controller) if compared else (),
            )
            rows.append(row)
        return rows, first

    # compiling takes longer than simulating, and lets other threads go on
    with ThreadPoolExecutor(2) as pool:
        found = dict(zip(known, pool.map(tracked, known), strict=True))
    every = round(KEPT_PERIOD / setup.machine.model.dt)
    signals = {
        name: {
            task: Signals(*(values[::every] for values in vars(one).values()))
            for task, one in found[name][1].items()
        }
        for name in DRAWN
    }
    ranking = tuple(row for rows, _ in found.values() for row in rows)
    return Result(ranking, signals, gap_curve(setup), beam_study())


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
        rows.append(GapRow(sharpness, *(abs(smooth[task] / true[task] - 1) for task in TASKS)))
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
                rows.append(FamilyRow(task, plant, True, np.inf, np.inf))
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


def _rms(by_task: dict[str, Signals]) -> dict[str, float]:
    """RMS end-effector error of every task [m]."""
    squares = {task: np.mean((one.tool - one.wanted) ** 2) for task, one in by_task.items()}
    return {task: float(np.sqrt(square)) for task, square in squares.items()}


@eqx.filter_jit
def _both(plant: Plant, controller: Controller, references: Reference) -> Rollout:
    return jax.vmap(lambda reference: simulate(plant, controller, reference))(references)
