"""Figures drawn by a process of their own while the command goes on."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from matplotlib.figure import Figure

from experiments.beside import Beside
from experiments.reports.figures.shared.png import save_figure


@contextmanager
def drawn_beside(figures: Mapping[Path, Figure]) -> Iterator[None]:
    """Write figures while the block runs; they are written when it ends.

    Args:
        figures: by their files.
    """
    with Beside() as process:
        drawn = process.submit(_save, dict(figures))
        yield
        drawn()


def _save(figures: Mapping[Path, Figure]) -> None:
    for path, figure in figures.items():
        save_figure(figure, path)
