"""`jcontour bench gantry`: steps per second of the gantry in every engine."""

from typing import Any

from rich.console import Console

from experiments.benchmarks.gantry_engines import engines, show_engines
from experiments.options import Bench

SECONDS = 2.0  # for each rate


def rows(flags: Bench) -> dict[str, Any]:
    """Agreement and rates, those of many machines for the batch that is asked for.

    Raises:
        ValueError: several batches.
    """
    if len(flags.batch) > 1:
        raise ValueError(
            f"batch: needs one number for the gantry, received {', '.join(map(str, flags.batch))}"
        )
    return {"engines": engines(SECONDS, *flags.batch)}


def show(console: Console, summary: dict[str, Any]) -> None:
    """The table."""
    show_engines(summary["engines"], console)
