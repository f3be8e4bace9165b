"""Laps of a part on a machine's family: what is learned from, the law, its bound, the runs."""

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.designs.design import Design
from jcontour.app.files.results.loop_results import LearnedMachine, StoredLap
from jcontour.app.flags.loops import Learn
from jcontour.app.jobs.job import Task
from jcontour.app.machines.machine import Machine, MachineLimits
from jcontour.app.runs.checks.machine_limits import largest_asked, limits_asked
from jcontour.controller import Controller
from jcontour.controllers.learning.laps import (
    Convergence,
    LearningLaw,
    RunLap,
    diverged_lap,
    impulse_responses,
    laps_of,
    paying_laps,
)
from jcontour.controllers.learning.norm_optimal import norm_optimal
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import family_batching, stack_plants
from jcontour.simulation.metrics import Metrics, score_signals

SMOOTHINGS = (0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512)  # tried in turn
CONTOURING = 0.9  # of the weight, where there is a contour: lag is a tenth as dear
LINEAR, NOISY = "linear model", "linear model, encoder noise"


class Setting(NamedTuple):
    """A controller on a part, and how the machine is learned from."""

    machine: Machine  # what is run
    controller: Controller  # with the weights of the start
    fed: Any  # what the controller is fed
    reference: Reference  # of one lap

    @property
    def shape(self) -> tuple[int, int]:
        """(T, m) of a correction."""
        return self.reference.steps, self.reference.position.shape[-1]

    @property
    def path(self) -> Float[Array, "T m"]:
        """Positions of the reference [m]."""
        return self.reference.position[: self.reference.steps]

    def laps(self, plant: Callable[[Any], Plant]) -> RunLap:
        """Laps on the plant that each number gives."""
        positions = self.machine.positions(self.fed)
        return laps_of(plant, self.controller, self.reference, positions)


def setting(design: Design, job: Task) -> Setting:
    """The design's start on a part."""
    machine = design.machine
    machine.positions(design.fed)  # raises where laps have nothing to read
    reference = job.reference(machine.model.dt, design.preview)
    return Setting(machine, design.complete(design.start), design.fed, reference)


def linear_nominal(one: Setting) -> Plant:
    """Linear nominal machine along the part."""
    return one.machine.linear_nominal(one.fed, one.path)


def noisy(one: Setting, seed: int) -> Callable[[Any], Plant]:
    """Linear model behind encoders with noise in place of counts, anew in every lap."""

    def of_lap(lap) -> Plant:
        key = jax.random.fold_in(jax.random.key(seed), lap)
        return one.machine.noisy_nominal(key, one.fed, one.path)

    return of_lap


def read_anew(one: Setting, seed: int) -> Callable[[Plant, Any], Plant]:
    """A plant of the true family in each lap: its encoders' noise is another in every one."""

    def of_lap(plant: Plant, lap) -> Plant:
        key = jax.random.fold_in(jax.random.key(seed), lap)
        return one.machine.with_noise(plant, key, one.shape[0], one.fed)

    return of_lap


class Prepared(NamedTuple):
    """A law, its numbers, and what is known of it before the first lap."""

    law: LearningLaw
    numbers: dict[str, float]
    convergence: Convergence


def prepared_law(one: Setting, flags: Learn) -> Prepared:
    """The norm-optimal law.

    Its smoothing is the least with which the ratio from lap to lap is below one on the whole
    family, unless it is given; where there is none, the one with the least ratio.
    """
    nominal = linear_nominal(one)
    slopes = _slopes(one)
    family = [partial(slopes, plant) for plant in one.machine.linear_family(one.fed, one.path)]
    part = 0.0 if one.machine.error == "tracking" else CONTOURING
    run = one.laps(lambda lap: nominal)
    base = norm_optimal(run, one.reference, contouring=part, effort=flags.effort)
    smoothings = SMOOTHINGS if flags.smoothing is None else (flags.smoothing,)
    known = impulse_responses(base, family, one.shape, max(smoothings))
    tried = []
    for smoothing in smoothings:
        tried.append((known.convergence(smoothing), smoothing))
        if tried[-1][0].estimate < 1:
            break
    best, smoothing = min(tried, key=lambda one: one[0].estimate)
    numbers = {"effort": flags.effort, "smoothing": smoothing}
    return Prepared(base.with_smoothing(smoothing), numbers, best)


def _slopes(one: Setting) -> Callable[[Plant, Array], Array]:
    """Change of the measured positions of a plant with the correction, at the first lap.

    One program for all plants of one structure.
    """

    def slope(plant: Plant, change: Array) -> Array:
        def measured(correction):
            return -one.laps(lambda lap: plant)(correction, jnp.zeros((), int)).error

        return jax.jvp(measured, (jnp.zeros(one.shape),), (change,))[1]

    return eqx.filter_jit(slope)


class LapScores(NamedTuple):
    """Errors [m] and control of one lap of every machine."""

    tool: Float[Array | np.ndarray, "*machines"]
    measured: Float[Array | np.ndarray, "*machines"]
    control: Float[Array | np.ndarray, "*machines"]


class BestLap(NamedTuple):
    """Lap of the linear model with the least error of the tool [m]; laps begin with one."""

    lap: int
    error: float
    correction: Float[Array, "T m"]


class Learner:
    """Laps, one after the other, on the linear model, on it with noise, and on the true family.

    Noise is another in every lap: laps that all had the same would learn it.
    """

    def __init__(self, one: Setting, law: LearningLaw, seed: int):
        self.one, self.law = one, law
        nominal = linear_nominal(one)
        self.singles: list[Callable[[Any], Plant]] = [lambda lap: nominal, noisy(one, seed)]
        self.anew = read_anew(one, seed)
        self.family = stack_plants(one.machine.true_family(one.fed))
        self.names = [LINEAR, NOISY, *one.machine.family_names]
        self.best: BestLap | None = None

    def noise(self) -> float:
        """RMS error of the tool that noise makes in the first lap, by the linear model [m]."""
        still, first = jnp.zeros(self.one.shape), jnp.asarray(0)
        without, with_noise = (advance(still, first)[2] for advance in (self._first, self._second))
        shift = with_noise - without + self.one.reference.position[: self.one.reference.steps]
        scored = eqx.filter_jit(score_signals)
        metrics = scored(shift, jnp.zeros_like(shift), self.one.reference)
        return float(self._error(metrics))

    def run(self, laps: int, done: Callable[[int], None]) -> list[LearnedMachine]:
        """All laps, `done` hears each; a machine that diverges is left out from then on."""
        count = len(self.names)
        corrections = [jnp.zeros(self.one.shape) for _ in self.singles]
        stacked = jnp.zeros((count - len(self.singles), *self.one.shape))
        rows: list[LapScores] = []
        for lap in range(laps):
            number, all_scores = jnp.asarray(lap), []
            for k, advance in enumerate((self._first, self._second)):
                used = corrections[k]
                corrections[k], scores, _ = advance(used, number)
                if k == 0 and (self.best is None or scores.tool < self.best.error):
                    self.best = BestLap(lap + 1, float(scores.tool), used)
                all_scores.append(jax.tree.map(lambda x: np.asarray(x)[None], scores))
            stacked, scores = self._together(self.family, stacked, number)
            all_scores.append(jax.tree.map(np.asarray, scores))
            rows.append(
                LapScores(*(np.concatenate(each) for each in zip(*all_scores, strict=True)))
            )
            done(1)
            if all(diverged_lap(_measured(rows, k)) for k in range(count)):
                break
        return [_machine(name, rows, k) for k, name in enumerate(self.names)]

    @cached_property
    def _first(self) -> Callable[[Any, Any], Any]:
        return jax.jit(partial(self._lap, self.singles[0]))

    @cached_property
    def _second(self) -> Callable[[Any, Any], Any]:
        return jax.jit(partial(self._lap, self.singles[1]))

    @cached_property
    def _together(self) -> Callable[[Any, Any, Any], Any]:
        def on_family(family, corrections, number):
            def on_plant(pair):
                plant, correction = pair
                return self._lap(partial(self.anew, plant), correction, number)[:2]

            return family_batching(family)(on_plant, (family, corrections))

        return eqx.filter_jit(on_family)

    def _lap(self, plant: Callable[[Any], Plant], correction: Array, number: Array):
        """Correction of the next lap, the scores of this one, and its output."""
        run, reference = self.one.laps(plant)(correction, number), self.one.reference
        measured = reference.position[: reference.steps] - run.error
        tool, seen = (
            score_signals(signal, run.control, reference) for signal in (run.output, measured)
        )
        scores = LapScores(self._error(tool), self._error(seen), tool.rms_control)
        return self.law.update(correction, run.error), scores, run.output

    def _error(self, metrics: Metrics) -> Array:
        return getattr(metrics, f"rms_{self.one.machine.error}_error")


def _machine(name: str, rows: Sequence[LapScores], k: int) -> LearnedMachine:
    """Laps of one machine, to the one at which it diverged."""
    measured = _measured(rows, k)
    diverged = diverged_lap(measured)
    kept = rows[:diverged]
    tool = [1e6 * float(row.tool[k]) for row in kept]
    return LearnedMachine(
        name=name,
        tool_um=tool,
        measured_um=[1e6 * value for value in measured[: len(kept)]],
        control=[float(row.control[k]) for row in kept],
        diverged=diverged,
        pays_until=paying_laps(tool),
    )


def _measured(rows: Sequence[LapScores], k: int) -> list[float]:
    """Measured error of one machine, lap by lap [m]."""
    return [float(row.measured[k]) for row in rows]


def shifted(reference: Reference, best: BestLap) -> Float[np.ndarray, "T m"]:
    """Positions [m] of the reference at every sample, with the correction of a lap."""
    return np.asarray(reference.position[: reference.steps]) + np.asarray(best.correction)


def stored_lap(
    position: Float[np.ndarray, "T m"],
    dt: float,
    best: BestLap,
    limits: MachineLimits,
    axes: Sequence[str],
) -> StoredLap | None:
    """Summary of shifted positions [m] at periods [s]; None where nothing was learned."""
    if best.lap == 1:
        return None
    speed, acceleration = largest_asked(position, dt, at_rest=False)
    shift = np.asarray(best.correction)
    return StoredLap(
        lap=best.lap,
        error_um=1e6 * best.error,
        largest_um=1e6 * float(np.abs(shift).max()),
        first_um=1e6 * float(np.linalg.norm(shift[0])),
        speed=float(speed.max()),
        acceleration=float(acceleration.max()),
        limits=limits_asked(speed, acceleration, limits, axes),
    )
