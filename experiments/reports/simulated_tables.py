"""Tables that `jcontour simulate` prints."""

from rich.console import Console
from rich.table import Table

from experiments.files.simulated_result import SimulatedResult
from experiments.reports.tables import (
    columns_of,
    metric_cells,
    peak_line,
    plain_table,
    read_line,
    say,
)


def show_simulated(result: SimulatedResult, console: Console) -> None:
    """The table, what was read, and one sentence."""
    console.print(plant_table(result))
    if result.read is not None:
        say(console, f"Read {read_line(result.contour, result.read, result.machine.axes)}")
    say(console, sentence(result))


def plant_table(result: SimulatedResult) -> Table:
    """One row per plant of the family."""
    headings = [heading for _, heading, _ in columns_of(result.error)]
    rows = [
        [plant, *metric_cells(metrics, result.error)] for plant, metrics in result.plants.items()
    ]
    run = f"{result.controller} on {result.contour}, {result.samples} samples"
    title = f"{run}, {result.feed_law}, {result.machine.nonsmooth_effects}"
    return plain_table(title, ["plant", *headings], rows)


def sentence(result: SimulatedResult) -> str:
    """Where the largest error is; plants that diverge come first."""
    lost = [plant for plant, metrics in result.plants.items() if metrics.diverged]
    words = []
    if lost:
        words.append(
            f"It diverges on {len(lost)} of {len(result.plants)} plants: {', '.join(lost)}."
        )
    if result.peak is not None:
        line = peak_line(result.peak, result.error, result.machine.axes)
        words.append(f"{line[0].upper()}{line[1:]}.")
    return " ".join(words)
