"""Runs of a controller on every contour and every plant, with the signals kept.

Tables, figures and netCDF are made of them.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jcontour.app.jobs.job import Task
from jcontour.app.machines.machine import Fed, Machine
from jcontour.controller import Controller, Plan
from jcontour.motion import Reference, pad
from jcontour.plant import Plant
from jcontour.simulation import stack_plants, stack_references
from jcontour.simulation.closed_loop import check_run, follow, prepared
from jcontour.simulation.evaluation import family_batching, member, platform_batching
from jcontour.simulation.metrics import Metrics, contour_error, score_signals


class Replay(NamedTuple):
    """Metrics and signals of all runs.

    Metrics have the axes (contour, plant). Output [m], control and contour error vector [m] are
    those of every sample, with the axes (contour, plant, time, ...).
    """

    metrics: Metrics
    output: np.ndarray
    control: np.ndarray
    contour_error: np.ndarray


class Scenarios(NamedTuple):
    """Jobs and plants of a replay, stacked once."""

    jobs: tuple[Task, ...]  # the contours
    training: tuple[bool, ...]  # which of them the tuner has seen
    plants: tuple[str, ...]  # names of the plants, the nominal one first
    references: Reference  # (contour,) stacked and padded
    family: Plant  # (plant,) stacked

    @classmethod
    def of(
        cls,
        jobs: Sequence[Task],
        training: Sequence[bool],
        machine: Machine,
        fed: Fed,
        preview: int,
        steps: int = 0,
    ) -> "Scenarios":
        """Scenarios over the true machines of the family.

        Runs are padded to one length, and to so many `steps` at least: those of one length share
        what is compiled for them.
        """
        runs = [job.reference(machine.model.dt, preview) for job in jobs]
        references = stack_references([pad(run, max(run.steps, steps)) for run in runs])
        family = stack_plants(machine.true_family(fed))
        return cls(tuple(jobs), tuple(training), tuple(machine.family_names), references, family)

    def jobs_seen(self, trained: bool) -> list[Task]:
        """The jobs that the tuner has seen, or those that it has not."""
        return [job for job, seen in zip(self.jobs, self.training, strict=True) if seen is trained]


def replay(controller: Controller, scenarios: Scenarios) -> Replay:
    """Run the controller over all scenarios."""
    check_run(scenarios.family, controller, scenarios.references)
    references, plans = scenarios.references, prepared_plans(controller, scenarios.references)
    return replayed(*_runs(scenarios.family, controller, references, plans), references)


def replayed(output: Any, control: Any, references: Reference) -> Replay:
    """Runs with these signals (contour, plant, time, ...), scored along their references."""
    metrics, error = _scored(output, control, references)
    return Replay(*jax.device_get((metrics, output, control, error)))


def prepared_plans(controller: Controller, references: Reference) -> Plan:
    """Plans of a controller for stacked references, axis 0; one program for all of them."""
    paths = jax.device_get(references)
    count = len(paths.mask)
    plans = [jax.device_get(prepared(controller, member(paths, k))) for k in range(count)]
    return jax.tree.map(lambda *leaves: jax.device_put(np.stack(leaves)), *plans)


@eqx.filter_jit
def _runs(
    family: Plant, controller: Controller, references: Reference, plans: Plan
) -> tuple[Any, ...]:
    """Output and control (contour, plant, time, ...)."""

    def on_contour(planned: tuple[Reference, Plan]):
        reference, plan = planned

        def on_plant(plant: Plant):
            run = follow(plant, controller, plan, reference)
            return run.output, run.control

        return family_batching(family)(on_plant, family)

    return platform_batching()(on_contour, (references, plans))


@jax.jit  # apart from the runs, because controllers share it
def _scored(output: Array, control: Array, references: Reference) -> tuple[Metrics, Array]:
    """Metrics (contour, plant), and the contour error (contour, plant, time, axis)."""

    def on_contour(one: tuple[Reference, Array, Array]):
        reference, output, control = one
        side_by_side = jnp.swapaxes(output, 0, 1), jnp.swapaxes(control, 0, 1)
        error = contour_error(side_by_side[0], reference)
        return score_signals(*side_by_side, reference), jnp.swapaxes(error, 0, 1)

    return platform_batching()(on_contour, (references, output, control))


def measured_speeds(output: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Speed [m/s] and acceleration [m/s^2] of the axes from outputs (..., T, m), by differences."""
    speed = np.diff(output, axis=-2) / dt
    return speed, np.diff(speed, axis=-2) / dt


def scored(scenarios: Scenarios) -> np.ndarray:
    """(contour, time) which samples count."""
    return np.asarray(scenarios.references.mask)[:, : scenarios.references.steps]


def unpadded(scenarios: Scenarios) -> np.ndarray:
    """(contour, time) which samples belong to the runs, scored or not."""
    return np.asarray(scenarios.references.unpadded)


def desired(scenarios: Scenarios) -> np.ndarray:
    """(contour, time, axis) where the tool should be [m]."""
    return np.asarray(jnp.asarray(scenarios.references.position)[:, : scenarios.references.steps])
