"""The bent reference of a loop, within the machine's limits, its runs, its end and its moves.

A controller that lags is still under way when its reference ends, and may pass the end of the part:
the last point is held until the tool rests.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from rich.console import Console

from jcontour.app.files.bent_reference import Moves, moves_through
from jcontour.app.files.results.run_metrics import RunMetrics
from jcontour.app.files.results.verdict import LimitCheck, exceeded
from jcontour.app.jobs.job import Job, Task
from jcontour.app.jobs.replays import Replay, Scenarios, replay
from jcontour.app.jobs.sections import Section, halted
from jcontour.app.reports import tables
from jcontour.app.reports.progress import counted
from jcontour.app.runs.checks.machine_limits import (
    beyond_limits_asked,
    largest_asked,
    machine_limits,
)
from jcontour.app.runs.contour_summary import run_outline
from jcontour.app.runs.stored_loops import StoredLoop
from jcontour.controller import Controller, Plan
from jcontour.controllers.learning.laps import Learned
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import follow, prepared
from jcontour.simulation.evaluation import family_batching, stack_plants
from tuning.precompensation import MORE, ROUNDS, Bounds, Prices, precompensate

TRIES = 4  # of a roughness, each ten times the last
MOST_ROUNDS = MORE * ROUNDS
STILL = 1e-7  # [m]: a tool that stays within it rests
FIRST, MOST = 0.25, 2.0  # [s] that are tried, each twice the last; half of it has to be at rest
CONTOURING = 0.9  # of the weight, where there is a contour: lag is a tenth as dear


class Bent(NamedTuple):
    """A correction, and runs of the true family with and without it."""

    job: Task  # the run, with its last point held until the tools rest
    held: int | None  # samples for which it is held; None of a run that ends in motion
    rests: bool  # whether the tools rest by then
    reference: Reference  # of that, as it was
    correction: Float[np.ndarray, "T m"]  # shift of every sample (T, m) [m]
    roughness: float  # its price
    plants: tuple[str, ...]  # names
    before: Replay  # the runs
    after: Replay
    # of the machine, along the bent reference; of the reference itself those that it exceeds
    limits: list[LimitCheck]
    limits_before: list[LimitCheck]  # of the machine, without a bend
    # largest speed [m/s] and acceleration [m/s^2] of an axis along the bent reference
    asked: tuple[float, float]

    @property
    def position(self) -> Float[np.ndarray, "T m"]:
        """The bent reference [m]."""
        return np.asarray(self.reference.position)[: self.reference.steps] + self.correction

    def errors(self, runs: Replay, error: str) -> Float[np.ndarray, "P T"]:
        """Size of the error that counts, "contour" or "tracking", of every plant [m]."""
        wanted = np.asarray(self.reference.position)[: self.reference.steps]
        apart = runs.output[0] - wanted if error == "tracking" else runs.contour_error[0]
        return np.linalg.norm(apart, axis=-1)

    def metrics(self, runs: Replay) -> dict[str, RunMetrics]:
        """Metrics by plant."""
        return {
            name: RunMetrics.of(runs.metrics, lambda values, k=k: values[0, k])
            for k, name in enumerate(self.plants)
        }


def bent(loop: StoredLoop, roughness: float, console: Console) -> Bent:
    """The correction of the loop's first part.

    The price is raised tenfold while a limit is exceeded that is kept without a bend.
    """
    machine, controller, job = loop.machine, loop.controller, loop.jobs[0]
    dt = machine.model.dt
    first = job.reference(dt, controller.preview)
    path = first.position[: first.steps]
    family = stack_plants(list(machine.linear_family(loop.fed, path)))
    at_rest = not isinstance(job, Job) or job.at_rest
    held, rests = None, True
    doing = f"{ROUNDS} rounds of bending, up to {MOST_ROUNDS} where limits bind"
    with console.status("running the reference until the tool rests"):
        if at_rest:
            settled = settling(job, family, controller, dt)
            rests = settled is not None
            held = round(MOST / dt) if settled is None else settled
            job = with_held_end(job, held)
        tables.say(console, run_outline(job, dt, len(machine.family_names), doing))
        reference = job.reference(dt, controller.preview)
        scenarios = Scenarios.of([job], [False], machine, loop.fed, controller.preview)
        before = replay(controller, scenarios)
    limits_before = machine_limits(before, scenarios, machine)
    wanted = np.asarray(reference.position)[: reference.steps]
    part = 0.0 if machine.error == "tracking" else CONTOURING
    stays, bounds, stated = halted(job), None, machine.limits.acceleration
    if stated is not None:
        # Bends with which the reference keeps the acceleration of the machine, or asks for as much
        # as before; a run that begins or ends in motion has no bend there
        beyond = 1 if at_rest else 0
        rows = np.pad(wanted, ((beyond, beyond), (0, 0)), mode="edge")
        bends = np.diff(rows, 2, axis=0)
        _, usual = largest_asked(wanted, dt, at_rest)
        reach = np.broadcast_to(np.maximum(stated, usual) * dt**2, bends.shape)
        ends = ((1 - beyond, 1 - beyond), (0, 0))
        bounds = Bounds(-np.pad(bends, ends), np.pad(reach, ends, constant_values=np.inf))

    def priced(price: float) -> Bent:
        with counted(console, ROUNDS, "rounds") as done:
            correction = precompensate(
                family,
                controller,
                reference,
                Prices(part, roughness=price),
                held=stays,
                bounds=bounds,
                tell=lambda number: done(1),
            ).correction
        after = replay(Learned(controller, jnp.asarray(correction)), scenarios)
        asked = beyond_limits_asked(wanted + correction, wanted, machine, at_rest)
        limits = [*asked, *machine_limits(after, scenarios, machine)]
        speed, acceleration = largest_asked(wanted + correction, dt, at_rest)
        most = float(speed.max()), float(acceleration.max())
        runs = scenarios.plants, before, after
        return Bent(
            job, held, rests, reference, correction, price, *runs, limits, limits_before, most
        )

    result = priced(roughness)
    for attempt in range(1, TRIES):
        broken = bool(exceeded(result.limits)) or _lost(result.after)
        if not broken or _lost(before) or exceeded(limits_before):
            break  # no smoother shift mends what is so without one
        smoother = roughness * 10**attempt
        more = f"{ROUNDS} more rounds, with roughness {smoother:.3g}"
        tables.say(console, f"A limit is exceeded or a plant does not follow: {more}.")
        result = priced(smoother)
    return result


def _lost(runs: Replay) -> bool:
    """Whether a plant does not follow."""
    return bool(np.asarray(runs.metrics.diverged).any())


def moves_along(
    position: Float[np.ndarray, "T m"], dt: float, run: Sequence[Section], source: str
) -> list[Moves]:
    """Moves through samples [m] of dt [s], section by section, each from where the last ends."""
    moves, place = [], position[0]
    for section in run:
        if section.rapid:
            at = [section.first, *section.corners, section.last]
            straight = Moves(position[at], np.diff(at) * dt, 0.0, rapid=True)
        else:
            rows = position[section.first : section.last + 1].copy()
            rows[0] = place
            straight = moves_through(rows, dt)
        by_line: dict[int, list[str]] = {}
        for line, words in section.asked:
            by_line.setdefault(line, []).append(words)
        asked = "; ".join(f"line {line}: {', '.join(words)}" for line, words in by_line.items())
        moves.append(straight._replace(asked=f"{source}, {asked}" if asked else ""))
        place = straight.ends[-1]
    return moves


def with_held_end(job: Task, samples: int) -> Task:
    """The run whose last point is held for so many samples."""
    if isinstance(job, Job):
        return job._replace(settling=samples)
    return job._replace(duration=job.duration + samples * job.dt)


def settling(job: Task, family: Plant, controller: Controller, dt: float) -> int | None:
    """Samples of dt [s] behind the end until every tool rests; None where one does not."""
    hold = FIRST
    while hold <= 2 * MOST:
        samples = max(2, round(hold / dt))
        reference = with_held_end(job, samples).reference(dt, controller.preview)
        output = np.asarray(
            _outputs(family, controller, prepared(controller, reference), reference)
        )
        tail = output[:, job.samples - 1 :]
        moving = np.linalg.norm(tail - tail[:, -1:], axis=-1).max(axis=0) > STILL
        if not np.isfinite(tail).all():
            return None
        if not moving[samples // 2 :].any():
            return int(np.append(np.flatnonzero(moving) + 1, 0).max(initial=0))
        hold *= 2
    return None


@eqx.filter_jit
def _outputs(
    family: Plant, controller: Controller, plan: Plan, reference: Reference
) -> Float[Array, "P T m"]:
    def on(plant: Plant) -> Float[Array, "T m"]:
        return follow(plant, controller, plan, reference).output

    return family_batching(family)(on, family)
