"""The gantry in three engines: how well they agree, and how many steps of 0.25 ms a second they do."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from experiments.reports.tables import digits, plain_table
from jcontour.plant import Plant
from jcontour.plants.gantry.gantry import SUBSTEP, Gantry
from jcontour.plants.gantry.mjx_engine import GantryMJX
from jcontour.plants.gantry.mujoco_engine import GantryMuJoCo
from jcontour.plants.gantry.parameters import thesis_gantry

BATCH = 1000  # where nothing else is asked for
STATES = 200  # random ones, for the agreement
CURRENTS = (0.7, 0.4, -0.3)  # [A] held while it is timed: the beam twists
HOST_STEPS = 1000  # of the engine on the host in one call: what a call costs does not show
REPEATS = 3  # the best of them counts


def engines(seconds: float, batch: int = BATCH) -> list[dict[str, Any]]:
    """A row for each engine: largest differences to our model in one step, relative to the step's own size, and rates.

    Args:
        seconds: that each rate is measured for, about.
        batch: machines at once.

    Raises:
        ValueError: fewer than two at once.
    """
    if batch < 2:
        raise ValueError(f"batch: needs at least two machines at once, received {batch}")
    p = thesis_gantry()
    plants: dict[str, Plant] = {
        "jcontour": Gantry(p, SUBSTEP),
        "MuJoCo": GantryMuJoCo(p, SUBSTEP),
        "MJX": GantryMJX(p, SUBSTEP),
    }
    rows = []
    for name, plant in plants.items():
        on_host = isinstance(plant, GantryMuJoCo)
        single = (
            HOST_STEPS * _rate(GantryMuJoCo(p, HOST_STEPS * SUBSTEP, HOST_STEPS), 1, seconds)
            if on_host
            else _rate(plant, 1, seconds)
        )
        batched = None if on_host else _rate(plant, batch, seconds)
        apart = _difference(plant, plants["jcontour"])
        rows.append(
            {
                "engine": name,
                "difference": apart,
                "single": single,
                "batch": batch,
                "batched": batched,
            }
        )
    return rows


def _difference(plant: Plant, ours: Plant) -> float:
    """Largest difference of the next state, each component over the largest change of its kind."""
    random = np.random.default_rng(0)
    places, moves = random.uniform(-0.5, 0.5, (STATES, 2)), random.uniform(-2e-4, 2e-4, (STATES, 2))
    currents = random.uniform(-10, 10, (STATES, 3))

    def stepped(plant: Plant):
        def one(place, move, current):
            state = plant.initial_state(place, move)
            for _ in range(3):  # the first two make it twist
                state = plant.step(state, current)
            return plant.measure(state)

        return np.asarray(jax.jit(jax.vmap(one))(places, moves, currents))

    wanted = stepped(ours)
    return float(np.max(np.abs(stepped(plant) - wanted) / np.abs(wanted).max(axis=0)))


def _rate(plant: Plant, batch: int, seconds: float) -> float:
    """Steps per second of all members together, after compilation; as many steps as fill the time."""

    def run(start, steps):
        return jax.lax.fori_loop(
            0, steps, lambda _, state: plant.step(state, jnp.array(CURRENTS)), start
        )

    start = plant.initial_state(jnp.zeros(2), jnp.zeros(2))
    if batch > 1:
        start, run = (
            jax.tree.map(lambda leaf: jnp.tile(leaf, (batch, 1)), start),
            jax.vmap(run, (0, None)),
        )
    compiled, steps = jax.jit(run).lower(start, 1).compile(), 1
    while (
        spent := min(_spent(compiled, start, steps) for _ in range(REPEATS))
    ) < seconds / REPEATS:
        steps = int(steps * min(100.0, 1.2 * seconds / REPEATS / max(spent, 1e-6))) + 1
    return batch * steps / spent


def _spent(program: Callable[..., Any], *arguments: Any) -> float:
    before = time.perf_counter()
    jax.block_until_ready(program(*arguments))
    return time.perf_counter() - before


def show_engines(engines: list[dict[str, Any]], console: Console) -> None:
    """Agreement and rates of the engines."""
    ours = engines[0]
    rows = [
        [
            row["engine"],
            "-" if row is ours else f"{row['difference']:.1e}",
            *_shown_rate(row["single"], ours["single"]),
            *_shown_rate(row["batched"], ours["batched"]),
        ]
        for row in engines
    ]
    alone, together = (
        ("million steps\na second", "of ours"),
        (f"{ours['batch']:,} at once:\nmillion steps a second", "of ours"),
    )
    console.print(
        plain_table(
            "Runge-Kutta steps of 0.25 ms in every engine",
            ("engine", "difference\nof a step", *alone, *together),
            rows,
        )
    )


def _shown_rate(rate: float | None, ours: float) -> tuple[str, str]:
    return ("-", "-") if rate is None else (digits(rate / 1e6), f"{rate / ours:.2g}")
