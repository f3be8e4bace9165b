"""Figures drawn by a process of their own while the command goes on.

Drawing is as long as it is because it is Python: beside JAX, which traces in Python too, a thread
would gain nothing.
"""

import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from matplotlib.figure import Figure

from experiments.reports.figures.png import save_figure


@contextmanager
def drawn_beside(figures: Mapping[Path, Figure]) -> Iterator[None]:
    """Write figures while the block runs; they are written when it ends.

    The process knows no Ctrl-C of its own: it is stopped with the block. Where it fails, the
    figures are drawn here, and what was wrong is raised here.

    Args:
        figures: by their files.
    """
    with tempfile.TemporaryFile() as file:
        pickle.dump(dict(figures), file)
        file.seek(0)
        drawer = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=file,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            yield
            failed = drawer.wait() != 0
        finally:
            drawer.kill()
            drawer.wait()
    if failed:
        _save(figures)


def _save(figures: Mapping[Path, Figure]) -> None:
    for path, figure in figures.items():
        save_figure(figure, path)


if __name__ == "__main__":
    _save(pickle.load(sys.stdin.buffer))
