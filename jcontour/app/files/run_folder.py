"""The run folder: it appears whole, once, and so does every file in it."""

import json
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from jcontour._regular_files import content_of
from jcontour.app.files.checks import json_value

SETTINGS, RESULT = "settings.json", "result.json"
MOST_BYTES = 512 * 2**20  # of such a file
_made: list[tuple[object, Path]] = []  # by this process, behind the flags of the command


class RunError(ValueError):
    """A run folder that cannot be used as asked; one line."""


class Interrupted(KeyboardInterrupt):
    """The user stopped a run; the message says how to go on."""


def default_folder(command: str) -> Path:
    """runs/<command>-<date>-<time>, with a number behind it where that exists."""
    stem = Path("runs") / f"{command}-{time.strftime('%Y%m%d-%H%M%S')}"
    return next(
        path
        for k in range(1, 10_000)
        if not (path := stem if k == 1 else stem.with_name(f"{stem.name}-{k}")).exists()
    )


def check_free(folder: Path) -> None:
    """Tell a folder that cannot become a run's before the work is done.

    Raises:
        RunError: there is a file of that name, or a folder that is not empty.
    """
    if folder.is_symlink() or folder.exists():
        if not folder.is_dir():
            raise RunError(f"{folder}: is a file; a run needs a folder; give another --out")
        if any(folder.iterdir()):
            raise RunError(
                f"{folder}: already holds something; give another --out (an interrupted tune, "
                "front, rank or sweep goes on with --resume)"
            )


def check_named(command: str, folders: Sequence[Path]) -> None:
    """Tell that a command needs run folders, where none is named and this folder is none.

    Raises:
        RunError: one is missing.
    """
    if folders and all(folder != Path() or (folder / SETTINGS).exists() for folder in folders):
        return
    raise RunError(
        f"{command}: needs a run folder; `jcontour tune PART` makes one and prints its name"
    )


def create(folder: Path | None, command: str, flags: Any, inputs: list[Path]) -> Path:
    """Make a run folder with its settings and copies of the files it read, or nothing at all.

    Where none is given, its name begins with the last word of the command.

    Raises:
        RunError: the folder already holds something, or cannot be made.
    """
    folder = folder or default_folder(command.split()[-1])
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as error:
        raise RunError(f"{folder}: cannot be made ({error.strerror})") from None
    try:
        made.chmod(0o755)
        # names stay: parts are called by them
        copies = {str(path): f"inputs/{k}/{path.name}" for k, path in enumerate(inputs)}
        for path, copy in copies.items():
            (made / copy).parent.mkdir(parents=True)
            shutil.copyfile(path, made / copy)
        settings = {
            "command": command,
            "command_line": ["jcontour", *sys.argv[1:]],
            "flags": plain(flags),
            "inputs": copies,
            "started": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
            "versions": versions(),
        }
        write_json(made / SETTINGS, settings)
        # fails where the folder holds anything, also when two runs start at once
        made.rename(folder)
    except OSError as error:
        shutil.rmtree(made, ignore_errors=True)
        check_free(folder)
        raise RunError(f"{folder}: cannot be made ({error.strerror})") from None
    _made.append((flags, folder))
    return folder


def remove_unfinished(flags: object) -> None:
    """Remove what a command of these flags made and left without a result: its name is free."""
    for its, folder in _made:
        if its is flags and not (folder / RESULT).exists():
            shutil.rmtree(folder, ignore_errors=True)


def versions() -> dict[str, str]:
    """Versions and the precision of everything that the numbers may depend on."""
    packages = ("jcontour", "jax", "jaxlib", "equinox", "optax", "numpy", "scipy")
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "precision": "float64",  # the commands refuse any other
        **{name: version_of(name) or "unknown" for name in packages},
    }


def version_of(package: str) -> str | None:
    """Version of an installed package; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def opened(folder: Path, command: str) -> dict[str, Any]:
    """Settings of a run of this command.

    Raises:
        RunError: it is not a run folder, or that of another command.
    """
    stored = read_json(folder, SETTINGS)
    if stored.get("command") != command:
        raise RunError(f"{folder}: holds a run of {stored.get('command')!r}, not of {command!r}")
    if not isinstance(stored.get("flags"), dict):
        raise RunError(f"{folder}: a run of another version of jcontour (it has no flags)")
    return stored


def read_json(folder: Path, name: str) -> dict[str, Any]:
    """A JSON file of a run folder.

    Raises:
        RunError: it is missing or not a JSON object.
    """
    try:
        value = json_value(content_of(folder / name, MOST_BYTES))
    except (FileNotFoundError, NotADirectoryError):
        raise RunError(
            f"{folder}: is not a run folder, or its run has not ended ({name} is missing)"
        ) from None
    except OSError as error:
        raise RunError(f"{folder / name}: cannot be read ({error.strerror or error})") from None
    except ValueError:
        raise RunError(f"{folder / name}: is not JSON") from None
    if not isinstance(value, dict):
        raise RunError(f"{folder / name}: needs a JSON object")
    return value


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a run while it is worked on; a killed process lets go.

    Raises:
        RunError: another process works on it.
    """
    try:
        import fcntl
    except ImportError:  # no such locks on Windows: there, do not resume a run twice at once
        yield
        return
    with (folder / SETTINGS).open() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RunError(f"{folder}: another process is at work on this run") from None
        yield


@contextmanager
def resumable(command: str, folder: Path) -> Iterator[None]:
    """Tell whoever interrupts a run how it goes on."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(f"go on with: jcontour {command} --resume {folder}") from None


def write(path: Path, fill: Callable[[Path], Any]) -> Path:
    """Write a file under a temporary name with `fill(temporary)`, and rename it.

    Raises:
        RunError: it cannot be written, as on a full disk.
    """
    # keeps the suffix: writers choose the format by it
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        fill(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise RunError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        temporary.unlink(missing_ok=True)
    return path


def write_json(path: Path, value: Any) -> Path:
    """Write a value as JSON; what is not finite becomes null."""
    return write(path, lambda temporary: temporary.write_text(json_text(value) + "\n"))


def json_text(value: Any) -> str:
    """JSON of plain values, NumPy included; NaN and inf, which JSON has not, become null."""
    return json.dumps(plain(value), indent=1, allow_nan=False)


def plain(value: Any) -> Any:
    """The same in dicts, lists, strings and numbers."""
    if is_dataclass(value):
        return plain(asdict(value))  # pyright: ignore[reportArgumentType]
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, (np.ndarray, np.generic)) or hasattr(value, "tolist"):
        return plain(np.asarray(value).tolist())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and value - value != 0:
        return None
    return value
