"""Runs of a controller on every contour and every plant, with the signals kept.

Tables, figures and netCDF are made of them.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from experiments.jobs.job import Task
from experiments.machines.machine import Fed, Machine
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant, State
from jcontour.simulation.closed_loop import check_run, follow
from jcontour.simulation.evaluation import (
    family_batching,
    platform_batching,
    stack_plants,
    stack_references,
)
from jcontour.simulation.metrics import Metrics, contour_error, score_signals

Watch = Callable[[Plant, State], Any]  # what is kept of a state beside its output: arrays


class Replay(NamedTuple):
    """Metrics and signals of all runs.

    Metrics have the axes (contour, plant). Output [m], control and contour error vector [m] are
    those of every sample, with the axes (contour, plant, time, ...).

    What was watched beside them has the same axes; None where nothing was.
    """

    metrics: Metrics
    output: np.ndarray
    control: np.ndarray
    contour_error: np.ndarray
    watched: Any = None


class Scenarios(NamedTuple):
    """Jobs and plants of a replay, stacked once.

    Attributes:
        jobs: the contours.
        training: which of them the tuner has seen.
        plants: names of the plants, the nominal one first.
        references: (contour,) stacked and padded.
        family: (plant,) stacked.
    """

    jobs: tuple[Task, ...]
    training: tuple[bool, ...]
    plants: tuple[str, ...]
    references: Reference
    family: Plant

    @classmethod
    def of(
        cls,
        jobs: Sequence[Task],
        training: Sequence[bool],
        machine: Machine,
        fed: Fed,
        preview: int,
    ) -> "Scenarios":
        """Scenarios over the true machines of the family."""
        references = stack_references([job.reference(machine.model.dt, preview) for job in jobs])
        family = stack_plants(machine.true_family(fed))
        return cls(tuple(jobs), tuple(training), tuple(machine.family_names), references, family)

    def jobs_seen(self, trained: bool) -> list[Task]:
        """The jobs that the tuner has seen, or those that it has not."""
        return [job for job, seen in zip(self.jobs, self.training, strict=True) if seen is trained]


def replay(controller: Controller, scenarios: Scenarios, watch: Watch | None = None) -> Replay:
    """Run the controller over all scenarios, and keep what `watch` sees at every sample.

    Raises:
        ValueError: the preview or the sample period does not fit.
    """
    check_run(scenarios.family, controller, scenarios.references)
    return Replay(
        *jax.device_get(_replay(controller, scenarios.family, scenarios.references, watch))
    )


@eqx.filter_jit
def _replay(
    controller: Controller, family: Plant, references: Reference, watch: Watch | None
) -> tuple[Any, ...]:
    def on_contour(reference: Reference):
        plan = controller.prepare(reference)

        def on_plant(plant: Plant):
            run = follow(plant, controller, plan, reference)
            watched = None if watch is None else jax.vmap(partial(watch, plant))(run.state)
            return (
                score_signals(run.output, run.control, reference),
                run.output,
                run.control,
                watched,
            )

        metrics, output, control, watched = family_batching(family)(on_plant, family)
        return (
            metrics,
            output,
            control,
            jax.vmap(lambda y: contour_error(y, reference))(output),
            watched,
        )

    return platform_batching()(on_contour, references)


def measured_speeds(output: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Speed [m/s] and acceleration [m/s^2] of the axes from outputs (..., T, m), by differences."""
    speed = np.diff(output, axis=-2) / dt
    return speed, np.diff(speed, axis=-2) / dt


def scored(scenarios: Scenarios) -> np.ndarray:
    """(contour, time) which samples count."""
    return np.asarray(scenarios.references.mask)[:, : scenarios.references.steps]


def desired(scenarios: Scenarios) -> np.ndarray:
    """(contour, time, axis) where the tool should be [m]."""
    return np.asarray(jnp.asarray(scenarios.references.position)[:, : scenarios.references.steps])
