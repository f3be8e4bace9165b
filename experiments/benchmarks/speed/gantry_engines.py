"""The gantry in three engines: how well they agree, and their steps of 0.25 ms per second."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from experiments.benchmarks.speed.timings import seconds
from jcontour.app.reports.tables import digits, plain_table
from jcontour.plant import Plant
from jcontour.plants.gantry.engines.mjx_engine import GantryMJX
from jcontour.plants.gantry.engines.mujoco_engine import GantryMuJoCo
from jcontour.plants.gantry.gantry import SUBSTEP, Gantry
from jcontour.plants.gantry.parameters import thesis_gantry

BATCH = 1000  # machines at once where nothing else is asked for
STATES = 200  # random ones, for the agreement
CURRENTS = (0.7, 0.4, -0.3)  # [A] held while it is timed: the beam twists
HOST_STEPS = 1000  # of the engine on the host in one call: the cost of a call does not show
REPEATS = 3  # the best of them counts


@dataclass(frozen=True)
class EngineRate:
    """Agreement and speed of one engine.

    Attributes:
        engine: its name.
        difference: largest difference to our model after three steps, relative to the largest
            value of each state.
        single: steps per second of one machine.
        batch: machines at once.
        batched: steps per second of all of them together; None where the engine cannot batch.
    """

    engine: str
    difference: float
    single: float
    batch: int
    batched: float | None


def engine_rates(
    time_for_each: float, batch: int = BATCH, tell: Callable[[str], None] = lambda line: None
) -> list[EngineRate]:
    """Our model first, then MuJoCo and MJX.

    Args:
        time_for_each: about how long each rate is measured [s].
        batch: machines at once.
        tell: receives a line after every engine.

    Raises:
        ValueError: fewer than two at once.
    """
    if batch < 2:
        raise ValueError(f"batch: needs at least two machines at once, received {batch}")
    differences, rows = engine_differences(), []
    for name, plant in _engines().items():
        if isinstance(plant, GantryMuJoCo):
            single, batched = _host_rate(time_for_each), None
        else:
            single, batched = _rate(plant, 1, time_for_each), _rate(plant, batch, time_for_each)
        rows.append(EngineRate(name, differences[name], single, batch, batched))
        tell(f"{name}: {digits(single)} steps per second of one machine")
    return rows


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


def _host_rate(time: float) -> float:
    """Steps per second of MuJoCo, which makes many steps in one call."""
    plant = GantryMuJoCo(thesis_gantry(), HOST_STEPS * SUBSTEP, HOST_STEPS)
    return HOST_STEPS * _rate(plant, 1, time)


def _rate(plant: Plant, batch: int, time: float) -> float:
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
    share = time / REPEATS
    while (spent := _fastest(compiled, start, steps)) < share:
        steps = int(steps * min(100.0, 1.2 * share / max(spent, 1e-6))) + 1
    return batch * steps / spent


def _fastest(program: Callable, start, steps: int) -> float:
    """Wall time of a program, the best of `REPEATS` [s]."""
    calls = range(REPEATS)
    return min(seconds(lambda: jax.block_until_ready(program(start, steps))) for _ in calls)


def show_engines(engines: Sequence[EngineRate], console: Console) -> None:
    """Print agreement and rates of the engines."""
    ours = engines[0]
    rows = []
    for row in engines:
        difference = "-" if row is ours else f"{row.difference:.1e}"
        single = _shown_rate(row.single, ours.single)
        batched = _shown_rate(row.batched, ours.batched)
        rows.append([row.engine, difference, *single, *batched])
    columns = (
        "engine",
        "difference\nof a step",
        "million steps\na second",
        "of ours",
        f"{ours.batch:,} at once:\nmillion steps a second",
        "of ours",
    )
    console.print(plain_table("Runge-Kutta steps of 0.25 ms in every engine", columns, rows))


def _shown_rate(rate: float | None, ours: float | None) -> tuple[str, str]:
    if rate is None or ours is None:
        return "-", "-"
    return digits(rate / 1e6), f"{rate / ours:.2g}"
