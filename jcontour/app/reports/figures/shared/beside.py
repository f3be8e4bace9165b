"""Figures drawn by a process of their own while the command goes on."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from matplotlib.figure import Figure

from jcontour.app.beside import Beside
from jcontour.app.reports.figures.shared.png import image, save_image


@contextmanager
def drawn_beside(figures: Mapping[Path, Figure]) -> Iterator[None]:
    """Write figures while the block runs; they are written when it ends.

    Args:
        figures: by their files.
    """
    with Beside() as process:
        files = {path: drawn_by(process, figure) for path, figure in figures.items()}
        yield
        for path, save in files.items():
            save(path)


def drawn_by(process: Beside, figure: Figure) -> Callable[[Path], Path]:
    """Let a process draw a figure; what is returned waits for it and writes the file."""
    drawn = process.submit(image, figure)
    return lambda path: save_image(drawn(), path)
