"""Results of a sweep so far, one file a program: no design is computed twice."""

import zipfile
from pathlib import Path

import numpy as np

from jcontour.app.files.run_folder import RunError, write


class SweepChunks:
    """Rows of metrics by name, in order; chunks that are in the folder already count.

    Args:
        folder: of the chunks; made when the first one is added.

    Raises:
        RunError: a chunk cannot be read, or one is missing.
    """

    def __init__(self, folder: Path):
        self.folder, self.rows, self._chunks = folder, 0, []
        for path in sorted(folder.glob("[0-9]*.npz")):
            if path != self._next():
                raise RunError(f"{self._next()}: is missing")
            self._count(_chunk(path))

    def add(self, chunk: dict[str, np.ndarray]) -> None:
        """Keep the next rows."""
        self.folder.mkdir(exist_ok=True)
        write(self._next(), lambda temporary: np.savez(temporary, **chunk))  # pyright: ignore[reportArgumentType]
        self._count(chunk)

    def whole(self) -> dict[str, np.ndarray]:
        """All rows by name."""
        names = self._chunks[0]
        return {name: np.concatenate([chunk[name] for chunk in self._chunks]) for name in names}

    def _next(self) -> Path:
        return self.folder / f"{self.rows:09d}.npz"

    def _count(self, chunk: dict[str, np.ndarray]) -> None:
        self._chunks.append(chunk)
        self.rows += len(chunk["diverged"])


def _chunk(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise RunError(f"{path}: cannot be read ({error})") from None
