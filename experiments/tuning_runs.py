"""From flags to a tuning problem: machine, jobs, family, controller, weights, limits."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import jax.numpy as jnp
import numpy as np

from experiments.catalogue import TERMINALS, contouring, job_named, machine_named
from experiments.jobs import Job, Pace
from experiments.machines import Machine
from experiments.options import Limited, Storage, Tune
from experiments.replays import Course
from experiments.runs import RunError, opened
from jcontour.controller import Controller
from jcontour.controllers.contouring_lq import LQWeights
from jcontour.controllers.observers import FilterObserver, kalman_gain
from jcontour.evaluation import stack_plants, stack_references
from tuning.objectives import AtMost, mean_contour_error, worst_contour_error
from tuning.parameters import LQSpace, Positive
from tuning.problem import Problem
from tuning.tune import Settings

F = TypeVar("F", bound=Storage)

TRAINING = ("cam", "circle", "square")
HELD_OUT = ("bracket", "ellipse", "lemniscate")  # the bracket's length would triple the minute that training takes
OWN_HELD_OUT = ("circle", "ellipse", "lemniscate")  # quick ones beside a part of the user's own
OBJECTIVES = {"worst": worst_contour_error, "mean": mean_contour_error}
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


@dataclass(frozen=True)
class TuningRun:
    """Everything that a tuning run consists of.

    Attributes:
        problem: on the smooth machines; the tuner sees nothing else.
        course: training and held-out contours, on the machines with quantised encoders.
        observer_gain: of the Kalman filter.
    """

    flags: Tune
    machine: Machine
    problem: Problem
    start: LQWeights
    settings: Settings
    course: Course
    observer_gain: np.ndarray

    def controller(self, weights: LQWeights) -> Controller:
        """What the weights build."""
        return self.problem.build(weights)

    @property
    def training_samples(self) -> int:
        """Samples of all training contours."""
        return sum(job.arc.size for job, trained in zip(self.course.jobs, self.course.training, strict=True) if trained)


def tuning_run(flags: Tune) -> TuningRun:
    """The run that the flags describe.

    Raises:
        ValueError: a flag, a file or their combination is wrong.
    """
    machine = machine_named(flags.plant)
    start, settings = start_weights(flags), tuner_settings(flags)
    pace = Pace.of(flags, machine)
    training = [job_named(name, pace) for name in flags.parts or TRAINING]
    held_out = [job_named(name, pace) for name in (OWN_HELD_OUT if flags.parts else HELD_OUT) if name not in flags.parts]
    gain = kalman_gain(machine.model, machine.control_noise, machine.measurement_noise)
    make = contouring(TERMINALS[flags.terminal])

    def build(weights: LQWeights) -> Controller:
        return FilterObserver(make(machine, weights, flags.preview), machine.model, gain)

    build(start)  # raises what is wrong with the weights, on the host
    training = _distinct(training)
    jobs, seen = [*training, *held_out], [True] * len(training) + [False] * len(held_out)
    course = Course.of(_distinct(jobs), seen, list(zip(_names(machine), machine.family(quantised=True), strict=True)), flags.preview)
    problem = Problem(
        build, stack_plants(_tuned_family(flags, machine)),
        stack_references([job.reference(machine.model.dt, flags.preview) for job in training]),
        OBJECTIVES[flags.objective], _space(flags), AtMost(**named_limits(flags)),
    )  # fmt: skip
    return TuningRun(flags, machine, problem, start, settings, course, np.asarray(gain))


def start_weights(flags: Limited) -> LQWeights:
    """Weights that the run begins with.

    Raises:
        ValueError: a weight is negative, not finite, or all are zero; tuning needs alpha and beta above zero.
    """
    if flags.preview < 1:
        raise ValueError(f"preview: needs at least one sample, received {flags.preview}")
    stage = jnp.ones(flags.preview) if getattr(flags, "stage_profile", False) else None
    return LQWeights(flags.alpha, flags.beta, flags.rho, stage)


def tuner_settings(flags: Any) -> Settings:
    """Effort of the tuner."""
    return Settings(
        starts=flags.starts, scatter=flags.scatter, inner_steps=flags.inner_steps, outer_steps=flags.outer_steps,
        tolerance=flags.tolerance, seed=flags.seed,
    )  # fmt: skip


def named_limits(flags: Limited) -> dict[str, float]:
    """Metric and bound in SI of every limit that the flags name.

    Raises:
        ValueError: a limit is not above zero.
    """
    given = {name: getattr(flags, name) for name in LIMITS if getattr(flags, name) is not None}
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name.replace('_', '-')}: a limit needs to be finite and above zero, received {value}")
    return {LIMITS[name][0]: value * LIMITS[name][1] for name, value in given.items()}


def flag_paths(flags: Any) -> list[Path]:
    """Files that the flags name."""
    return [Path(name) for name in (flags.plant, *flags.parts) if Path(name).suffix]


def resumed(flags: F, command: str) -> tuple[Path, F]:
    """Folder and flags of the run that `--resume` names; it reads its own copies of its input files.

    Raises:
        ValueError: other flags are given as well, or the folder does not hold a run of this command.
    """
    folder = flags.resume
    assert folder is not None
    given = [f.name for f in fields(flags) if f.name not in ("json", "resume") and getattr(flags, f.name) != f.default]
    if given:
        raise ValueError(f"resume: the run keeps its own settings; leave out --{given[0].replace('_', '-')}")
    stored = opened(folder, command)
    copies = {name: str(folder / copy) for name, copy in stored.get("inputs", {}).items()}
    try:
        known = {key: tuple(value) if isinstance(value, list) else value for key, value in stored["flags"].items()}
        known |= {"plant": copies.get(known["plant"], known["plant"]), "parts": tuple(copies.get(name, name) for name in known["parts"])}
        return folder, type(flags)(**{**known, "json": flags.json, "out": None, "resume": None})
    except (TypeError, KeyError):
        raise RunError(f"{folder}: its settings are not those of this version's {command}") from None


def _space(flags: Tune) -> LQSpace:
    for name in ("alpha", "beta"):
        if not getattr(flags, name) > 0:
            raise ValueError(f"{name}: tuning needs a start above zero, received {getattr(flags, name)}")
    return LQSpace(stage=Positive()) if flags.stage_profile else LQSpace()


def _tuned_family(flags: Tune, machine: Machine):
    family = machine.family(quantised=False)
    return family[:1] if flags.nominal_only else family


def _names(machine: Machine) -> list[str]:
    return [name for name, _, _ in machine.members]


def _distinct(jobs: list[Job]) -> list[Job]:
    """Names are coordinates in the netCDF file: parts of the same name are numbered."""
    named: list[Job] = []
    for job in jobs:
        names = {one.name for one in named}
        name = next(n for k in range(1, len(jobs) + 1) if (n := job.name if k == 1 else f"{job.name}-{k}") not in names)
        named.append(job._replace(name=name))
    return named
