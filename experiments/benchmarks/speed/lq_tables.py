"""Tables of `jcontour bench lq`."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table

from experiments.benchmarks.speed.lq_cases import PREVIEW, STEPS
from experiments.benchmarks.speed.lq_results import LQBench
from jcontour.app.reports import tables

RUNS = {  # heading of a column -> field, factor
    "batch": ("batch", 1.0),
    "runs/s": ("forward", 1.0),
    "with\ngradient": ("gradient", 1.0),
    "gradient /\nforward": ("gradient_ratio", 1.0),
    "with\nprofile": ("profile_ratio", 1.0),
    "times\nNumPy": ("times_numpy", 1.0),
}
COSTS = {
    "batch": ("batch", 1.0),
    "compile\ns": ("compiling", 1.0),
    "with\ngradient": ("compiling_gradient", 1.0),
    "memory\nMB": ("memory", 1e-6),
    "and with\ngradient": ("memory_gradient", 1e-6),
}
OTHERS = {
    "inputs": ("inputs", 1.0),
    "batch": ("batch", 1.0),
    "runs/s": ("forward", 1.0),
    "compile\ns": ("compiling", 1.0),
    "gains\napart": ("apart", 1.0),
}

WINDOWS = {
    "preview": ("preview", 1.0),
    "steps": ("steps", 1.0),
    "batch": ("batch", 1.0),
    "ms": ("milliseconds", 1.0),
    "times\nshortest": ("times_shortest", 1.0),
}
DEVICES = {
    "devices": ("devices", 1.0),
    "batch": ("batch", 1.0),
    "runs/s": ("forward", 1.0),
    "times\none": ("times_one", 1.0),
}


def show(console: Console, result: LQBench) -> None:
    """Print the tables, and what the runs are compared with."""
    kind = {"type": "type", "by": "by"}
    size = {"states of axes": "states", "by": "by"}
    title = f"Runs of {STEPS} steps, preview {PREVIEW}, X-Y table of 8 states, all metrics"
    console.print(_table(title, result.runs, kind, RUNS))
    console.print(_table("What they take", result.runs, kind, COSTS))
    title = "Other sizes, float64, machines of flexible axes on a straight line"
    console.print(_table(title, result.sizes, size, OTHERS))
    title = "Long previews, float64, uniform profile"
    console.print(_table(title, result.previews, {"horizon moves on": "horizon"}, WINDOWS))
    title = "Devices, float64, the same batch on each"
    console.print(_table(title, result.devices, {}, DEVICES))
    lines = []
    for name, rate in result.loops.items():
        counted = "float64, tracking and projected error only"
        lines.append(f"{name:<14} {tables.digits(rate)} runs/s, {counted}")
    tables.say(console, *lines)


def _table(
    title: str, rows: Sequence[Any], words: dict[str, str], columns: dict[str, tuple[str, float]]
) -> Table:
    """Rows as lines: columns of words first, then numbers times their factors."""
    lines = []
    for row in map(asdict, rows):
        numbers = [figures(factor * row[name]) for name, factor in columns.values()]
        lines.append([*(row[word] for word in words.values()), *numbers])
    return tables.plain_table(title, [*words, *columns], lines, text_columns=len(words))


def figures(value: float) -> str:
    """Digits of a number: large ones in full, others four significant."""
    return f"{value:,.0f}" if value >= 1e4 else tables.digits(value)
