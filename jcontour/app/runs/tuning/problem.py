"""From flags to a tuning problem: machine, design, jobs, family, limits."""

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from jcontour.analysis.uncertain_loops import BORNE
from jcontour.app.catalogue.choices import design_for, job_named, machine_named
from jcontour.app.designs.design import Design
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.held_out import held_out_like
from jcontour.app.jobs.job import Job, Pace, Task
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.jobs.stretches import representatives
from jcontour.app.machines.machine import Machine
from jcontour.app.runs.checks.machine_limits import OVERSHOOT
from jcontour.app.runs.spread.devices import batching_of
from jcontour.app.runs.tuning.limits import (
    counted,
    effort_limit,
    held_back,
    lag_limit,
    loop_limits,
    named_limits,
    noise_limit,
    probed_loops,
    ratio_limit,
    start_metrics,
)
from jcontour.controller import Controller
from jcontour.simulation.evaluation import stack_plants, stack_references
from jcontour.simulation.limit_use import AxisLimits, LimitUse
from tuning.objectives import (
    AtMost,
    Before,
    Objective,
    mean_contour_error,
    mean_tracking_error,
    typical_contour_error,
    typical_tracking_error,
    worst_contour_error,
    worst_tracking_error,
)
from tuning.parameters import Weights
from tuning.problem import Effort, Problem

OBJECTIVES: dict[tuple[str, str], Objective] = {  # flag, error that counts on the machine
    ("worst", "contour"): worst_contour_error,
    ("mean", "contour"): mean_contour_error,
    ("typical", "contour"): typical_contour_error,
    ("worst", "tracking"): worst_tracking_error,
    ("mean", "tracking"): mean_tracking_error,
    ("typical", "tracking"): typical_tracking_error,
}
PLENTY = 10_000  # training samples beyond which a run will not end within a minute
RESERVED = 0.97  # of a limit that the machine states: contours not trained may need more
WHOLE = 1.0  # of one that a loop may overshoot on them


@dataclass(frozen=True)
class TuningRun:
    """Everything that a tuning run consists of."""

    flags: Tune
    machine: Machine
    before: Design  # design that the tuned one is compared with
    design: Design  # of the controller that is tuned; its start is where the run begins
    problem: Problem  # on the smooth machines; the tuner sees nothing else
    settings: Effort
    # what is tuned on: the training contours, long programs by stretches of them
    learned: tuple[Task, ...]
    scenarios: Scenarios  # training and held-out contours as a whole, on the true machines
    limits: dict[str, float]  # metric and bound in SI

    @property
    def start(self) -> Weights:
        """Weights that the run begins with."""
        return self.design.start

    def controller(self, weights: Weights) -> Controller:
        """Controller with these weights."""
        return self.problem.build(weights)

    @property
    def training_samples(self) -> int:
        """Samples of all that is tuned on."""
        return sum(job.steps for job in self.learned)

    @property
    def by_stretches(self) -> bool:
        """Whether a long program is tuned by stretches of it."""
        return len(self.learned) != sum(self.scenarios.training)


def tuning_run(flags: Tune, made: Design | None = None) -> TuningRun:
    """The run that the flags describe."""
    asked = ratio_limit(flags) | loop_limits(flags)
    machine = machine_named(flags.plant) if made is None else made.machine
    settings, pace, usual = tuner_settings(flags), Pace.of(flags, machine), machine.usual
    # parts come before the design: a fault in line 1 of a program is reported at once
    training, held_out = _jobs(flags, machine, pace)
    before = design_for(machine, flags) if made is None else made
    # so do references before the first loop is searched: a preview longer than a run
    learned = tuple(one for job in training for one in representatives(job, machine.model.dt))
    runs = [job.reference(machine.model.dt, before.preview) for job in learned]
    design = before.tunable()
    if flags.free is not None:
        design = design.freed([name.strip() for name in flags.free.split(",")])
    design.check_start()
    jobs, seen = [*training, *held_out], [True] * len(training) + [False] * len(held_out)
    scenarios = Scenarios.of(_distinct(jobs), seen, machine, design.fed, design.preview)
    family = machine.smooth_family(design.fed)
    references = stack_references(runs)
    problem = Problem(
        design.complete,
        stack_plants(family[:1] if flags.nominal_only else family),
        references,
        OBJECTIVES[flags.objective, machine.error],
        design.space,
        batching=batching_of(flags),
    )
    start = held_back(machine, problem, design.start)
    limits = lag_limit(machine, design, references, start) | named_limits(flags)
    limits |= effort_limit(flags, usual, problem, design.start)
    stated = stated_axis_limits(machine)
    kept = [] if design.keeps_limits else _named(stated)
    if machine.response_uncertainty is not None:
        limits["response_doubt"] = BORNE
    limits |= noise_limit(flags, machine, design)
    limits |= asked | {f"{name}_use": WHOLE if name in OVERSHOOT else RESERVED for name in kept}
    problem = replace(
        problem,
        limits=AtMost(_before(flags, before, problem), **limits),
        loops=probed_loops(flags, problem, machine.response_uncertainty, counted(limits, machine)),
        axis_limits=stated if _named(stated) else None,
    )
    return TuningRun(flags, machine, before, design, problem, settings, learned, scenarios, limits)


def _jobs(flags: Tune, machine: Machine, pace: Pace) -> tuple[list[Task], list[Task]]:
    """Training and held-out contours."""
    usual = machine.usual
    own = [job_named(name, pace) for name in flags.parts]
    jobs = [job for job in own if isinstance(job, Job)]
    if jobs:
        return _distinct(own), [*held_out_like(jobs, pace)]
    names = usual.beside_own if own else usual.held_out
    held_out = [job_named(name, pace) for name in names if name not in flags.parts]
    return _distinct(own or [job_named(name, pace) for name in usual.training]), held_out


def tuner_settings(flags: Any) -> Effort:
    """Effort of the tuner."""
    return Effort(
        starts=flags.starts,
        scatter=flags.scatter,
        steps=flags.steps,
        tolerance=flags.tolerance,
        seed=flags.seed,
        every_start=flags.every_start,
    )


def stated_axis_limits(machine: Machine) -> AxisLimits:
    """Limits that the machine states, and what of its acceleration the samples hide."""
    stated = {name: getattr(machine.limits, name) for name in LimitUse._fields}
    stated["hidden"] = machine.hidden_acceleration
    return AxisLimits(
        **{name: None if value is None else jnp.asarray(value) for name, value in stated.items()}
    )


def _named(limits: AxisLimits) -> list[str]:
    return [name for name in LimitUse._fields if getattr(limits, name) is not None]


def _before(flags: Tune, before: Design, problem: Problem) -> Before | None:
    """The family's worst error of every contour under the start weights, where a limit asks.

    Of a contour that they do not follow nothing is asked.
    """
    if flags.max_error_ratio is None:
        return None
    metrics = start_metrics(replace(problem, build=before.complete), before.start)
    error = "contour" if problem.references.position.shape[-1] > 1 else "tracking"
    worst = np.max(getattr(metrics, f"rms_{error}_error"), axis=1)
    lost = np.any(metrics.diverged, axis=1)
    return Before(jnp.asarray(np.where(lost, np.inf, worst)), error)


def _distinct(jobs: list[Task]) -> list[Task]:
    """Names are coordinates in the netCDF file: parts of the same name are numbered."""
    named: list[Task] = []
    for job in jobs:
        names = {one.name for one in named}
        name = next(
            n
            for k in range(1, len(jobs) + 1)
            if (n := job.name if k == 1 else f"{job.name}-{k}") not in names
        )
        named.append(job._replace(name=name))
    return named
