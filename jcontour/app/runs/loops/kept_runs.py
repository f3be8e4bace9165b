"""Runs of a bounded MPC: on its model under what is within the bounds, and on the whole family."""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from jcontour.app.designs.predictive.bounded import Keeper
from jcontour.app.files.results.tolerance_result import KeptRun
from jcontour.app.machines.machine import Machine
from jcontour.guarantees.attacks import Attack
from jcontour.host.loop import HostRun, reported_loop
from jcontour.plant import Plant
from jcontour.plants.wrappers.encoders import Encoders
from jcontour.simulation.metrics import contour_error, tracking_error

FORGOTTEN = 8  # times the length of the responses: an attack of the filter and them


class Tried(NamedTuple):
    """A run and its error at every sample (T,) [m]."""

    row: KeptRun
    run: HostRun
    error: np.ndarray


def kept_runs(keeper: Keeper, seed: int = 0) -> Iterator[Tried]:
    """All runs, one after the other; those within the bounds come first."""
    machine, model = keeper.machine, Encoders(keeper.model)
    proven = promised_to(keeper)
    steps = keeper.reference.steps
    yield _tried(keeper, proven, "an attack", True, attacked(keeper, steps).on(model))
    random = at_random(keeper, steps, np.random.default_rng(seed))
    yield _tried(keeper, proven, "at random", True, random.on(model))
    yield _tried(keeper, proven, "encoder counts", True, machine.counted(keeper.model))
    for name, plant in zip(machine.family_names, machine.true_family(), strict=True):
        if name != proven:
            yield _tried(keeper, name, "encoder counts", False, plant)


def promised_to(keeper: Keeper) -> str:
    """The plant that the model is of: name of the member of the family."""
    machine, same = keeper.machine, np.ones(keeper.model.inputs)
    return next(
        name
        for name, gains, late in machine.members
        if late == keeper.late and np.array_equal(gains, same)
    )


def attacked(keeper: Keeper, steps: int) -> Attack:
    """The attack across the path where it is worst off, from either side in turn."""
    frames = keeper.mpc.certified(keeper.reference)
    worst = int(np.argmax(frames.certified[:steps]))
    direction = frames.directions[worst, -1]
    length = min(FORGOTTEN * keeper.mpc.response.length, steps)
    once = keeper.response.attack(keeper.model, keeper.around, direction, length)
    both = [np.concatenate([rows, -rows]) for rows in once]
    # one of them ends at the sample that needs most
    turned = [np.roll(rows, (worst + 1) % len(rows), axis=0) for rows in both]
    return Attack(*(np.resize(rows, (steps, rows.shape[1])) for rows in turned))


def at_random(keeper: Keeper, steps: int, generator: np.random.Generator) -> Attack:
    """Forces and encoder errors at an end of their range, from sample to sample at random."""
    model, around = keeper.model, keeper.around
    force = np.sign(generator.normal(size=(steps, model.inputs))) * np.asarray(around.force)
    return Attack(force, np.sign(generator.normal(size=(steps, model.axes))) * around.encoder)


def _tried(keeper: Keeper, name: str, disturbance: str, within: bool, plant: Plant) -> Tried:
    reference = keeper.reference
    run = reported_loop(plant, keeper.controller, reference, fallback="soft")
    error = _error(keeper.machine, run, reference)
    memory, report = run.rollout.final_memory.inner, run.report
    scored = np.asarray(reference.mask)[: reference.steps]
    row = KeptRun(
        plant=name,
        disturbance=disturbance,
        within=within,
        largest=float(np.max(error[scored])),
        left=None if memory.left < 0 else int(memory.left),
        fallbacks=report.fallbacks,
        control=tuple(np.abs(run.rollout.control).max(axis=0).tolist()),
        residual=report.worst_residual,
    )
    return Tried(row, run, error)


def _error(machine: Machine, run: HostRun, reference) -> np.ndarray:
    kind = tracking_error if machine.error == "tracking" else contour_error
    return np.linalg.norm(
        np.asarray(kind(jax.numpy.asarray(run.rollout.output), reference)), axis=1
    )
