"""Corners and random plants of the family under tuned weights: the tuner has seen a few."""

import equinox as eqx
import jax
import numpy as np

from jcontour.app.files.results.tuned_result import RobustTest
from jcontour.app.jobs.replays import Scenarios, prepared_plans
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.runs.tuning.problem import stated_axis_limits
from jcontour.controller import Controller, Plan
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import follow
from jcontour.simulation.evaluation import platform_batching, stack_references
from jcontour.simulation.limit_use import AxisLimits, LimitUse, limit_use
from jcontour.simulation.metrics import Metrics, score_signals

MEMBERS = 1000
SIDE_BY_SIDE = 100  # plants that are stepped together: fast on a CPU, little memory


def robust_test(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed, seed: int
) -> RobustTest | None:
    """Random plants, and the corners of the family, with all effects on every training contour.

    None for a family of one plant.
    """
    family = machine.random_family(MEMBERS, seed, fed)
    if family is None:
        return None
    jobs = scenarios.jobs_seen(True)
    dt, preview = scenarios.references.dt, scenarios.references.preview
    references = stack_references([job.reference(dt, preview) for job in jobs])
    plans = prepared_plans(controller, references)
    limits = stated_axis_limits(machine)
    metrics, uses = jax.device_get(_metrics(family, controller, references, plans, limits))
    errors = np.asarray(getattr(metrics, f"rms_{machine.error}_error"))  # (contour, member)
    lost = np.asarray(metrics.diverged)
    largest = np.where(lost, -1.0, errors)
    names = machine.random_names(MEMBERS, seed)
    contour, plant = np.unravel_index(np.argmax(largest), largest.shape)
    used = {
        name: np.where(lost, 0.0, getattr(uses, name))
        for name in uses._fields
        if getattr(limits, name) is not None
    }
    users = {name: np.unravel_index(np.argmax(one), one.shape) for name, one in used.items()}
    return RobustTest(
        members=MEMBERS,
        diverged=int(lost.any(axis=0).sum()),
        error=float(largest.max()),
        contour=jobs[contour].name,
        plant=names[plant],
        uses={name: float(one.max()) for name, one in used.items()},
        users={name: f"{jobs[c].name}, {names[k]}" for name, (c, k) in users.items()},
    )


@eqx.filter_jit
def _metrics(
    family: Plant,
    controller: Controller,
    references: Reference,
    plans: Plan,
    limits: AxisLimits,
) -> tuple[Metrics, LimitUse]:
    """Metrics and use of the machine's limits (contour, member)."""
    groups = jax.tree.map(lambda leaf: leaf.reshape(-1, SIDE_BY_SIDE, *leaf.shape[1:]), family)

    def on_contour(planned: tuple[Reference, Plan]) -> tuple[Metrics, LimitUse]:
        reference, plan = planned

        def on_plant(plant: Plant) -> tuple[Metrics, LimitUse]:
            run = follow(plant, controller, plan, reference)
            signals = run.output, run.control, reference
            return score_signals(*signals), limit_use(*signals, limits)

        grouped = jax.lax.map(jax.vmap(on_plant), groups)
        return jax.tree.map(lambda leaf: leaf.reshape(MEMBERS), grouped)

    return platform_batching()(on_contour, (references, plans))
