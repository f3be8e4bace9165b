"""What a sweep has found so far: one file for every program that ended, numbered by its first row, never written again."""

import zipfile
from pathlib import Path

import numpy as np

from experiments.files.run_folder import RunError, write


class SweptParts:
    """Rows of metrics by name, in order; what is there already counts.

    Args:
        folder: of the parts; made when the first one is added.

    Raises:
        RunError: a part cannot be read, or one is missing.
    """

    def __init__(self, folder: Path):
        self.folder, self.rows, self._parts = folder, 0, []
        for path in sorted(folder.glob("[0-9]*.npz")):
            if path != self._next():
                raise RunError(f"{self._next()}: is missing")
            self._count(_read(path))

    def add(self, part: dict[str, np.ndarray]) -> None:
        """Keep the next rows."""
        self.folder.mkdir(exist_ok=True)
        write(self._next(), lambda temporary: np.savez(temporary, **part))  # pyright: ignore[reportArgumentType]
        self._count(part)

    def whole(self) -> dict[str, np.ndarray]:
        """All rows by name."""
        return {
            name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]
        }

    def _next(self) -> Path:
        return self.folder / f"{self.rows:09d}.npz"

    def _count(self, part: dict[str, np.ndarray]) -> None:
        self._parts.append(part)
        self.rows += len(part["diverged"])


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise RunError(f"{path}: cannot be read ({error})") from None
