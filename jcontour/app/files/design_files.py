"""Results of a sweep's designs, a file each: they come in any order, and none is computed twice."""

from pathlib import Path
from typing import Generic, TypeVar

from jcontour.app.files.results.stored import from_json, to_json
from jcontour.app.files.run_folder import RunError, read_json, write_json

T = TypeVar("T")


class DesignFiles(Generic[T]):
    """Results by the number of their design; those that are in the folder already count.

    Args:
        folder: of the files; made when the first one is added.
        kind: of the results, a dataclass.

    Raises:
        RunError: a file cannot be read.
    """

    def __init__(self, folder: Path, kind: type[T]):
        self.folder = folder
        self.found: dict[int, T] = {}
        for path in sorted(folder.glob("[0-9]*.json")):
            self.found[int(path.stem)] = _read(path, kind)

    def add(self, number: int, result: T) -> None:
        """Keep the result of a design."""
        self.folder.mkdir(exist_ok=True)
        write_json(self.folder / f"{number:09d}.json", to_json(result))
        self.found[number] = result


def _read(path: Path, kind: type[T]) -> T:
    values = read_json(path.parent, path.name)
    try:
        return from_json(values, kind)
    except ValueError as error:
        raise RunError(f"{path}: is not of this version's sweep ({error})") from None
