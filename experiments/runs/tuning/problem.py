"""From flags to a tuning problem: machine, design, jobs, family, limits."""

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from experiments.catalogue.choices import design_for, job_named, machine_named
from experiments.designs.design import Design
from experiments.flags.shared import Limited
from experiments.flags.tuning import Tune
from experiments.jobs.held_out import held_out_like
from experiments.jobs.job import Job, Pace, Task
from experiments.jobs.random_contours import contour_jobs
from experiments.jobs.replays import Scenarios
from experiments.jobs.representatives import representatives
from experiments.machines.disturbance_bounds import Bounds, bounds_of, box_of, linear_machine
from experiments.machines.linear import LinearMachine
from experiments.machines.machine import Machine, Usual
from experiments.runs.spread.spreading import batching_of
from experiments.runs.tuning.family_loops import WINDOWS
from jcontour.analysis.stability import DELAY_SEARCH
from jcontour.analysis.uncertain_loops import BORNE, Doubt
from jcontour.controller import Controller
from jcontour.guarantees.disturbed_family import DisturbedFamily
from jcontour.guarantees.disturbed_loop import check_linear
from jcontour.motion.references import Reference
from jcontour.simulation.evaluation import stack_plants, stack_references
from jcontour.simulation.limit_use import AxisLimits
from jcontour.simulation.metrics import Metrics
from tuning.effort import Effort
from tuning.loops import ProbedLoops
from tuning.objectives import (
    CERTIFIED_USE,
    COUNT_NOISE,
    RATIO,
    AtMost,
    Before,
    Objective,
    certified_error,
    mean_contour_error,
    mean_tracking_error,
    typical_contour_error,
    typical_tracking_error,
    worst_contour_error,
    worst_tracking_error,
)
from tuning.parameters import Weights
from tuning.problem import Problem

OBJECTIVES: dict[tuple[str, str], Objective] = {  # flag, error that counts on the machine
    ("worst", "contour"): worst_contour_error,
    ("mean", "contour"): mean_contour_error,
    ("typical", "contour"): typical_contour_error,
    ("worst", "tracking"): worst_tracking_error,
    ("mean", "tracking"): mean_tracking_error,
    ("typical", "tracking"): typical_tracking_error,
    ("certified", "contour"): certified_error,
    ("certified", "tracking"): certified_error,
}
LIMITS = {  # flag -> metric, factor to SI
    "max_tracking_error_um": ("rms_tracking_error", 1e-6),
    "max_peak_tracking_error_um": ("peak_tracking_error", 1e-6),
    "max_peak_contour_error_um": ("peak_contour_error", 1e-6),
    "max_rms_control": ("rms_control", 1.0),
    "max_peak_control": ("peak_control", 1.0),
    "max_rms_increment": ("rms_increment", 1.0),
    "max_peak_increment": ("peak_increment", 1.0),
}
PLENTY = 10_000  # training samples beyond which a run will not end within a minute
LATE_RADIUS = 0.999  # of a loop at its delay margin: a ring has decayed after a few 1000 samples
RESERVED = 0.97  # of a limit that the machine states: contours not trained may need more


@dataclass(frozen=True)
class TuningRun:
    """Everything that a tuning run consists of.

    Attributes:
        before: design that the tuned one is compared with.
        design: of the controller that is tuned; its start is where the run begins.
        problem: on the smooth machines; the tuner sees nothing else.
        learned: what is tuned on: the training contours, long programs by stretches of them.
        scenarios: training and held-out contours as a whole, on the true machines.
        limits: metric and bound in SI.
    """

    flags: Tune
    machine: Machine
    before: Design
    design: Design
    problem: Problem
    settings: Effort
    learned: tuple[Task, ...]
    scenarios: Scenarios
    limits: dict[str, float]

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
        return sum(job.samples for job in self.learned)

    @property
    def by_stretches(self) -> bool:
        """Whether a long program is tuned by stretches of it."""
        return len(self.learned) != sum(self.scenarios.training)


def tuning_run(flags: Tune, made: Design | None = None) -> TuningRun:
    """The run that the flags describe.

    Args:
        flags: of the run.
        made: design of these flags, where it is known; a first loop takes a while to find.

    Raises:
        ValueError: a flag, a file or their combination is wrong.
    """
    asked = _ratio_limit(flags) | loop_limits(flags)
    machine = machine_named(flags.plant) if made is None else made.machine
    bounds = _bounds(flags, machine)
    settings, pace, usual = tuner_settings(flags), Pace.of(flags, machine), machine.usual
    # parts come before the design: a fault in line 1 of a program is told at once
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
        design.build,
        stack_plants(family[:1] if flags.nominal_only else family),
        references,
        _objective(flags, machine),
        design.space,
        batching=batching_of(flags),
    )
    limits = _lag_limit(machine, design, references) | named_limits(flags)
    limits |= _effort_limit(flags, usual, problem, design.start)
    stated = _stated_limits(machine)
    kept = [] if design.keeps_limits else _named(stated)
    if machine.doubt is not None:
        limits["response_doubt"] = BORNE
    limits |= _noise_limit(flags, machine, design)
    limits |= asked | {f"{name}_use": RESERVED for name in kept}
    if flags.objective == "certified" and stated.control is not None:
        limits[CERTIFIED_USE] = RESERVED
    problem = replace(
        problem,
        limits=AtMost(_before(flags, before, problem), **limits),
        loops=probed_loops(flags, problem, machine.doubt, counted(limits, machine)),
        axis_limits=stated if _named(stated) else None,
        disturbed=_disturbed(flags, machine, bounds, design, runs[0]),
    )
    return TuningRun(flags, machine, before, design, problem, settings, learned, scenarios, limits)


def _jobs(flags: Tune, machine: Machine, pace: Pace) -> tuple[list[Task], list[Task]]:
    """Training and held-out contours.

    Raises:
        ValueError: a name, a file or the words of random contours are wrong.
    """
    usual = machine.usual
    own = [job_named(name, pace) for name in flags.parts]
    jobs = [job for job in own if isinstance(job, Job)]
    if flags.contours is not None:
        training, held_out = contour_jobs(flags.contours, pace, flags.seed, jobs)
        return [*training], [*held_out]
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


def named_limits(flags: Limited) -> dict[str, float]:
    """Metric and bound in SI of every limit that the flags name.

    Raises:
        ValueError: a limit is not above zero.
    """
    given = {name: getattr(flags, name) for name in LIMITS if getattr(flags, name) is not None}
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            flag = name.replace("_", "-")
            raise ValueError(f"{flag}: a limit needs to be finite and above zero, received {value}")
    return {LIMITS[name][0]: value * LIMITS[name][1] for name, value in given.items()}


def _objective(flags: Tune, machine: Machine) -> Objective:
    """Objective of the flags; `regret` begins as `typical`, see `runs.regret`."""
    name = "typical" if flags.objective == "regret" else flags.objective
    return OBJECTIVES[name, machine.error]


def _lag_limit(machine: Machine, design: Design, references: Reference) -> dict[str, float]:
    """Bound on the RMS tracking error along contours: some samples of travel at the fastest feed.

    Contour error alone is also small for a tool that lags, or hardly moves.
    """
    if machine.error != "contour":
        return {}
    steps = jnp.linalg.norm(jnp.diff(references.position, axis=1), axis=-1)
    return {"rms_tracking_error": design.lag * float(jnp.max(steps))}


def loop_limits(flags: Limited) -> dict[str, float]:
    """Bounds on the peak sensitivity, and on the radius with more delay, where flags ask for them.

    Raises:
        ValueError: the bound is not above 1, which no loop keeps; or the delay is not one.
    """
    bound, more = flags.max_sensitivity, flags.min_delay_margin
    if bound is not None and not bound > 1:
        raise ValueError(f"max-sensitivity: no loop keeps 1 or less, received {bound}")
    if not 0 <= more <= DELAY_SEARCH:
        raise ValueError(f"min-delay-margin: needs 0 to {DELAY_SEARCH} samples, received {more}")
    late = {"late_radius": LATE_RADIUS} if more else {}
    return late if bound is None else {"peak_sensitivity": bound, **late}


def _stated_limits(machine: Machine) -> AxisLimits:
    """Limits that the machine states."""
    stated = machine.limits._asdict()
    return AxisLimits(
        **{name: None if value is None else jnp.asarray(value) for name, value in stated.items()}
    )


def _named(limits: AxisLimits) -> list[str]:
    return [name for name, value in limits._asdict().items() if value is not None]


def _bounds(flags: Tune, machine: Machine) -> Bounds | None:
    """Bounds of the disturbances; None on a machine that is not linear, where none are asked for.

    Raises:
        ValueError: they are asked for there, or one of them is wrong.
    """
    asked = flags.objective == "certified" or (flags.force, flags.encoder_um) != (None, None)
    if not (asked or isinstance(machine, LinearMachine)):
        return None
    return bounds_of(linear_machine(machine), flags.force, flags.encoder_um)


def _disturbed(
    flags: Tune, machine: Machine, bounds: Bounds | None, design: Design, reference: Reference
) -> DisturbedFamily | None:
    """The family under bounded disturbances, where the objective is to be certified.

    Raises:
        ValueError: the controller is not linear.
    """
    if bounds is None or flags.objective != "certified":
        return None
    machine = linear_machine(machine)
    family = machine.exact_family(design.fed)[: 1 if flags.nominal_only else None]
    box = box_of(family[0], bounds, machine, design.fed)
    check_linear(family[0], design.build(design.start), reference)
    largest = machine.limits.control
    limit = np.full(box.force.size, np.inf if largest is None else largest)
    return DisturbedFamily(stack_plants(family), box.force, box.noise, limit)


def probed_loops(
    flags: Limited, problem: Problem, doubt: Doubt | None, count: float | None
) -> ProbedLoops | None:
    """The frozen loops that the limits look at; None where none does.

    Args:
        flags: of the run.
        problem: whose loops they are.
        doubt: how far off the response may be.
        count: of the encoders [m], where the noise of counts is limited.
    """
    if not loop_limits(flags) and doubt is None and count is None:
        return None
    return ProbedLoops.of(
        problem.plants, problem.references, WINDOWS, flags.min_delay_margin, doubt, count
    )


def _noise_limit(flags: Limited, machine: Machine, design: Design) -> dict[str, float]:
    """Bound on the RMS control by encoder counts, as a part of the machine's largest control.

    None where nothing is counted, or the machine states no limit of its control.

    Raises:
        ValueError: the flag is not above zero.
    """
    part, largest = flags.max_count_noise, machine.limits.control
    if part is not None and not (np.isfinite(part) and part > 0):
        raise ValueError(
            f"max-count-noise: a limit needs to be finite and above zero, received {part}"
        )
    if part is None or largest is None or design.fed == "state" or machine.resolution is None:
        return {}
    return {COUNT_NOISE: part * float(np.min(largest))}


def counted(limits: dict[str, float], machine: Machine) -> float | None:
    """A count of the encoders [m] where its noise is limited."""
    return machine.resolution if COUNT_NOISE in limits else None


def _ratio_limit(flags: Tune) -> dict[str, float]:
    """Bound on the errors over those of the start, where the flags ask for it.

    Raises:
        ValueError: it is not finite and above zero.
    """
    ratio = flags.max_error_ratio
    if ratio is None:
        return {}
    if not (np.isfinite(ratio) and ratio > 0):
        raise ValueError(
            f"max-error-ratio: a limit needs to be finite and above zero, received {ratio}"
        )
    return {RATIO: ratio}


def _before(flags: Tune, before: Design, problem: Problem) -> Before | None:
    """The family's worst error of every contour under the start weights, where a limit asks.

    Of a contour that they do not follow nothing is asked.
    """
    if flags.max_error_ratio is None:
        return None
    metrics = start_metrics(replace(problem, build=before.build), before.start)
    error = "contour" if problem.references.position.shape[-1] > 1 else "tracking"
    worst = np.max(getattr(metrics, f"rms_{error}_error"), axis=1)
    lost = np.any(metrics.diverged, axis=1)
    return Before(jnp.asarray(np.where(lost, np.inf, worst)), error)


def start_metrics(problem: Problem, start: Weights) -> Metrics:
    """Metrics (contour, plant) of the first weights on the smooth machines."""
    return eqx.filter_jit(lambda problem, weights: problem.metrics(weights))(problem, start)


def _effort_limit(
    flags: Limited, usual: Usual, problem: Problem, start: Weights
) -> dict[str, float]:
    """Bound on the RMS control, as a multiple of what the start needs.

    None where the RMS control is bounded otherwise, or neither flags nor machine ask for it.

    Raises:
        ValueError: the flag is not above zero, or both kinds of bound are given.
    """
    effort = flags.max_effort
    if effort is not None and flags.max_rms_control is not None:
        raise ValueError(
            "max-effort, max-rms-control: both limit the RMS control; give one of them"
        )
    if effort is not None and not (np.isfinite(effort) and effort > 0):
        raise ValueError(
            f"max-effort: a limit needs to be finite and above zero, received {effort}"
        )
    effort = effort or usual.effort
    if effort is None or flags.max_rms_control is not None:
        return {}
    return {"rms_control": effort * float(np.max(start_metrics(problem, start).rms_control))}


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
