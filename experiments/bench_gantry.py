"""`jcontour bench gantry`: steps per second of the gantry in every engine."""

from typing import Any

from rich.console import Console

from experiments.gantry_engines import engines
from experiments.options import Bench
from experiments.yuan_gantry_tables import show_engines

SECONDS = 2.0  # for each rate


def rows(flags: Bench) -> dict[str, Any]:
    """Agreement and rates."""
    return {"engines": engines(SECONDS)}


def show(console: Console, summary: dict[str, Any]) -> None:
    """The table."""
    show_engines(summary["engines"], console)
