"""`jcontour bench gantry`: steps per second of the gantry in every engine."""

from collections.abc import Callable
from dataclasses import dataclass

from rich.console import Console

from experiments.benchmarks.speed.gantry_engines import EngineRate, engine_rates, show_engines
from jcontour.app.flags.others import Bench

SECONDS = 2.0  # for each rate


@dataclass(frozen=True)
class GantryBench:
    """One row for every engine."""

    engines: list[EngineRate]


def measured(flags: Bench, tell: Callable[[str], None]) -> GantryBench:
    """Agreement and rates; those of many machines for the batch that is asked for.

    Raises:
        ValueError: several batches, or a batch of one.
    """
    if len(flags.batch) > 1:
        given = ", ".join(map(str, flags.batch))
        raise ValueError(f"batch: needs one number for the gantry, received {given}")
    return GantryBench(engine_rates(SECONDS, *flags.batch, tell=tell))


def show(console: Console, result: GantryBench) -> None:
    """Print the table."""
    show_engines(result.engines, console)
