"""Yuan 2020, chapter 3: tracking with a flexible axis, Tables 3.1 and 3.2, Figs 3.3, 3.8 to 3.11.

The thesis's tables were measured on its test bench: our simulation of its model stands beside them
and is not fitted to them. The beam of the bench (Fig. 3.3) is one of Euler and Bernoulli here, in
place of finite elements.
"""

from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from experiments.papers import THESIS
from jcontour import Controller, Plant, Reference, simulate, stack_references
from jcontour.app.catalogue.choices import design_for, job_named
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Pace
from jcontour.app.machines.flexible_axis import FlexibleMachine, thesis_machine
from jcontour.plants import FlexibleAxis, SmoothFlexibleAxis, beam_modes, thesis_axis, thesis_beam
from jcontour.plants.flexible_axis.cantilever import beam_shapes
from jcontour.simulation.closed_loop import Rollout

SOURCE = f"{THESIS}, chapter 3 (performance of tracking control)"
JOBS = {"A": "task-a", "B": "task-b"}  # in the catalogue
BASELINE = "cascade"  # the thesis's P-PI with its gains
CONTROLLERS = (
    BASELINE,
    "cascade-notch",
    "cascade-leso-exact",
    "cascade-leso-euler",
    "cascade-leso",
)
# [s/m]; the default, 1e3, turns the friction within 1 mm/s
SHARPNESSES = (100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4)
TASKS = tuple(JOBS)  # point to point, to and fro along a cosine
KEPT_PERIOD = 5e-3  # [s] between the samples of a signal: a fourteenth of the link's period
DRAWN = CONTROLLERS[:3]  # Figs 3.8 to 3.11
MODES = 3  # of the beam


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
class Signals:
    """Motor, end effector and reference [m], and current [A], of one run."""

    motor: Float[np.ndarray, " T"]
    tool: Float[np.ndarray, " T"]
    wanted: Float[np.ndarray, " T"]
    current: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class BeamStudy:
    """Frequencies of the beam [Hz], and the load at its tip that gives the identified one."""

    bare_hz: tuple[float, ...]
    loaded_hz: tuple[float, ...]
    identified_hz: float  # sqrt(k / m_e) of section 3.3
    load_kg: float
    stiffness: float  # identified k over 3 E I / L^3, that of the beam at its tip
    place: Float[np.ndarray, " x"]  # along the beam, over its length
    shapes: Float[np.ndarray, "modes x"]  # of the loaded beam, one at their largest


@dataclass(frozen=True)
class Result:
    """Controllers on both tasks, signals of some, the gap of the smooth twin, and the beam."""

    columns: dict[str, dict[str, Columns]]  # by controller and task
    signals: dict[str, dict[str, Signals]]  # by controller and task, every `KEPT_PERIOD`
    # of the smooth twin in RMS end-effector error, relative, over `SHARPNESSES`
    gap: Float[np.ndarray, "sharpnesses tasks"]
    beam: BeamStudy


class Setup:
    """The thesis's axis and its two tasks.

    The controllers are fed the exact position and speed of the motor, as in its simulations.
    """

    def __init__(self):
        self.machine: FlexibleMachine = thesis_machine()
        self.true = FlexibleAxis(self.machine.parameters, self.machine.model.dt)
        pace = Pace(self.machine, None, None)
        self.jobs = [job_named(name, pace) for name in JOBS.values()]

    def controller(self, name: str) -> Controller:
        """A controller of the catalogue with the thesis's gains."""
        design = design_for(self.machine, Simulate(controller=name))
        return design.build(design.start)

    def signals(self, controller: Controller, plant: Plant | None = None) -> dict[str, Signals]:
        """Signals of every task on the true axis, or on another plant."""
        dt, preview = self.machine.model.dt, controller.preview
        references = stack_references([job.reference(dt, preview) for job in self.jobs])
        run = _both(self.true if plant is None else plant, controller, references)
        rows = (run.measurement[0], run.output, references.position, run.control)
        return {
            task: Signals(*(np.asarray(row)[k, : job.samples, 0] for row in rows))
            for k, (task, job) in enumerate(zip(JOBS, self.jobs, strict=True))
        }


def run(quick: bool = False) -> Result:
    """Simulate everything."""
    setup = Setup()
    whole = {name: setup.signals(setup.controller(name)) for name in CONTROLLERS}
    every = round(KEPT_PERIOD / setup.machine.model.dt)
    return Result(
        columns={
            name: {task: columns(signals) for task, signals in by_task.items()}
            for name, by_task in whole.items()
        },
        signals={
            name: {
                task: Signals(*(values[::every] for values in vars(one).values()))
                for task, one in whole[name].items()
            }
            for name in DRAWN
        },
        gap=gap_curve(setup),
        beam=beam_study(),
    )


def columns(signals: Signals) -> Columns:
    """Columns of Tables 3.1 and 3.2 [mm, A]; the last input acts on no sample and is left out."""
    motor = 1e3 * np.abs(signals.motor - signals.wanted)
    tool = 1e3 * np.abs(signals.tool - signals.wanted)
    return Columns(
        em_max=float(motor.max()),
        em_mean=float(motor.mean()),
        ee_max=float(tool.max()),
        ee_mean=float(tool.mean()),
        def_max=1e3 * float(np.abs(signals.motor - signals.tool).max()),
        u_mean=float(np.abs(signals.current[:-1]).mean()),
    )


def gap_curve(setup: Setup) -> Float[np.ndarray, "sharpnesses tasks"]:
    """Smooth twin against the true axis under the thesis's cascade, over the sharpness."""
    controller = setup.controller(BASELINE)
    parameters, dt = setup.machine.parameters, setup.machine.model.dt
    twins = [SmoothFlexibleAxis(parameters, dt, sharpness) for sharpness in SHARPNESSES]
    sizes = []
    for plant in (setup.true, *twins):
        by_task = setup.signals(controller, plant)
        errors = [by_task[task].tool - by_task[task].wanted for task in TASKS]
        sizes.append([np.sqrt(np.mean(error**2)) for error in errors])
    true, *others = np.array(sizes)
    return np.abs(np.array(others) / true - 1)


@eqx.filter_jit
def _both(plant: Plant, controller: Controller, references: Reference) -> Rollout:
    return jax.vmap(lambda reference: simulate(plant, controller, reference))(references)


def beam_study() -> BeamStudy:
    """Modes of the bare beam and of the loaded one."""
    axis, beam = thesis_axis(), thesis_beam()
    k, m = float(axis.stiffness[0]), float(axis.tool_mass[0])
    wanted = float(np.sqrt(k / m))

    def off(load: float) -> float:
        return float(beam_modes(thesis_beam(load), 1).frequency[0]) - wanted

    load = float(np.asarray(brentq(off, 1e-6, 10.0, xtol=1e-12)))
    loaded, place = beam_modes(thesis_beam(load), MODES), np.linspace(0, 1, 101)
    shapes = beam_shapes(loaded.beta, place)
    hertz = 1 / (2 * np.pi)
    return BeamStudy(
        tuple((beam_modes(beam, MODES).frequency * hertz).tolist()),
        tuple((loaded.frequency * hertz).tolist()),
        wanted * hertz,
        load,
        k / (3 * beam.stiffness / beam.length**3),
        place,
        shapes / np.abs(shapes).max(axis=1, keepdims=True),
    )
