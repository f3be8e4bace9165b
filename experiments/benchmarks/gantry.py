"""`jcontour bench gantry`: the gantry in three engines, how well they agree, and their speed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from experiments.benchmarks.timings import seconds
from experiments.tables import Table
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import digits
from jcontour.plant import Plant
from jcontour.plants.gantry.gantry import SUBSTEP, Gantry, thesis_gantry
from jcontour.plants.gantry.mujoco_engine import GantryMJX, GantryMuJoCo

BATCH = 1000  # machines at once where nothing else is asked for
SECONDS = 2.0  # for each rate
STATES = 200  # random ones, for the agreement
CURRENTS = (0.7, 0.4, -0.3)  # [A] held while it is timed: the beam twists
HOST_STEPS = 1000  # of the engine on the host in one call: the cost of a call does not show
REPEATS = 3  # the best of them counts


@dataclass(frozen=True)
class EngineRate:
    """Agreement and speed of one engine."""

    engine: str
    difference: float  # to our model after three steps, over the largest value of each state
    single: float  # steps per second of one machine
    batch: int  # machines at once
    batched: float | None  # steps per second of all together; None where it cannot batch


def measured(flags: Bench, tell: Callable[[str], None]) -> list[EngineRate]:
    """Agreement and rates of our model, of MuJoCo, and of MJX; of so many machines at once.

    Raises:
        ValueError: several batches, or fewer than two machines at once.
    """
    if len(flags.batch) > 1:
        given = ", ".join(map(str, flags.batch))
        raise ValueError(f"batch: needs one number for the gantry, received {given}")
    (batch,) = flags.batch or (BATCH,)
    if batch < 2:
        raise ValueError(f"batch: needs at least two machines at once, received {batch}")
    differences, rows = engine_differences(), []
    for name, plant in _engines().items():
        if isinstance(plant, GantryMuJoCo):
            # many steps in one call
            plant = GantryMuJoCo(thesis_gantry(), HOST_STEPS * SUBSTEP, HOST_STEPS)
            single, batched = HOST_STEPS * _rate(plant, 1), None
        else:
            single, batched = _rate(plant, 1), _rate(plant, batch)
        rows.append(EngineRate(name, differences[name], single, batch, batched))
        tell(f"{name}: {digits(single)} steps per second of one machine")
    return rows


def tables(result: list[EngineRate]) -> Iterator[Table]:
    """Agreement and rates of the engines."""
    ours, *_ = result
    columns = {
        "engine": "engine",
        "difference\nof a step": "difference:.1e",
        "million steps\na second": lambda row: digits(row.single / 1e6),
        "of ours": lambda row: f"{row.single / ours.single:.2g}",
        f"{ours.batch:,} at once:\nmillion steps a second": lambda row: digits(
            row.batched and row.batched / 1e6
        ),
        "of ours ": lambda row: f"{row.batched / ours.batched:.2g}" if row.batched else "-",
    }
    yield Table("Runge-Kutta steps of 0.25 ms in every engine", result, columns)


def _engines() -> dict[str, Plant]:
    """Our model first."""
    kinds = {"jcontour": Gantry, "MuJoCo": GantryMuJoCo, "MJX": GantryMJX}
    return {name: kind(thesis_gantry(), SUBSTEP) for name, kind in kinds.items()}


def engine_differences() -> dict[str, float]:
    """Largest difference of the next state to our model, each component over its largest value."""
    random = np.random.default_rng(0)
    places = random.uniform(-0.5, 0.5, (STATES, 2))
    moves = random.uniform(-2e-4, 2e-4, (STATES, 2))
    currents = random.uniform(-10, 10, (STATES, 3))

    def stepped(plant: Plant):
        def one(place, move, current):
            state = plant.initial_state(place, move)
            for _ in range(3):  # the first two make it twist
                state = plant.step(state, current)
            return plant.measure(state)

        return np.asarray(jax.jit(jax.vmap(one))(places, moves, currents))

    states = {name: stepped(plant) for name, plant in _engines().items()}
    wanted = states["jcontour"]
    largest = np.abs(wanted).max(axis=0)
    return {name: float(np.max(np.abs(one - wanted) / largest)) for name, one in states.items()}


def _rate(plant: Plant, batch: int) -> float:
    """Steps per second of all members together, after compilation."""

    def run(start, steps):
        def step(_, state):
            return plant.step(state, jnp.array(CURRENTS))

        return jax.lax.fori_loop(0, steps, step, start)

    start = plant.initial_state(jnp.zeros(2), jnp.zeros(2))
    if batch > 1:
        start = jax.tree.map(lambda leaf: jnp.tile(leaf, (batch, 1)), start)
        run = jax.vmap(run, (0, None))
    compiled, steps = jax.jit(run).lower(start, 1).compile(), 1
    share = SECONDS / REPEATS

    def fastest() -> float:
        runs = range(REPEATS)
        return min(seconds(lambda: jax.block_until_ready(compiled(start, steps))) for _ in runs)

    while (spent := fastest()) < share:
        steps = int(steps * min(100.0, 1.2 * share / max(spent, 1e-6))) + 1
    return batch * steps / spent
