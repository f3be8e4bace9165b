"""Figures of a paper as PNG files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from experiments.files.run_folder import write

DOTS = 150  # per inch


def save_figures(
    figures: dict[str, Callable[[dict[str, Any]], Figure]], summary: dict[str, Any], folder: Path
) -> list[Path]:
    """Draw every figure from the numbers of a run; the names are those of the files."""
    return [_saved(folder / f"{name}.png", make(summary)) for name, make in figures.items()]


def _saved(path: Path, figure: Figure) -> Path:
    return write(path, lambda temporary: figure.savefig(temporary, dpi=DOTS))
