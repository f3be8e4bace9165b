"""Interrupted work as npz files, every float to the last bit: a tuning run, rows of a sweep.

A resumed run so ends as an uninterrupted one.
"""

import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jcontour.app.files.run_folder import RunError, write
from jcontour.simulation.limit_use import LimitUse
from jcontour.simulation.metrics import Metrics
from tuning.descents.descent import begin
from tuning.descents.quadratic_step import Model
from tuning.objectives import LoopPeaks, Outcome
from tuning.point import Evaluated
from tuning.tuner import TuneState

STATE = "state.npz"
TREES = ("history", "descent")  # stored leaf by leaf; every other field is a number or an array
_DESCENT = begin(np.zeros(1), Model(*(np.zeros((1,) * axes) for axes in (2, 1, 3, 2))))
_ZERO: Any = np.zeros((1, 1))
_OUTCOME = Outcome(  # the structure of one with everything
    Metrics(
        **{
            name: np.zeros((), bool if name == "diverged" else float)
            for name in Metrics.__dataclass_fields__
        }
    ),
    LoopPeaks(*[_ZERO] * len(LoopPeaks._fields)),
    LimitUse(*[_ZERO] * len(LimitUse._fields)),
    _ZERO,
    _ZERO,
)


def save_state(folder: Path, state: TuneState) -> Path:
    """Write the state of a run; what was there before stays until the new file is whole."""
    arrays = {name: value for name, value in vars(state).items() if name not in TREES}
    trees: dict[str, Any] = {"descent": state.descent}
    if state.history:
        trees["history"] = jax.tree.map(lambda *leaves: np.stack(leaves), *state.history)
    leaves = jax.tree_util.tree_leaves_with_path(trees)
    arrays |= {jax.tree_util.keystr(path): leaf for path, leaf in leaves}
    return write(folder / STATE, lambda temporary: np.savez(temporary, **arrays))


def load_state(folder: Path) -> TuneState:
    """State of a run; a fresh one when it has not made its first step.

    Raises:
        RunError: the file is damaged.
    """
    if not (folder / STATE).exists():
        return TuneState()
    arrays = _arrays(folder / STATE)
    plain: dict[str, Any] = {}
    try:
        for one in fields(TuneState):
            if one.name not in TREES:
                plain[one.name] = _plain(arrays[one.name])
        if any(name.startswith("['descent']") for name in arrays):
            plain["descent"] = _tree("descent", _DESCENT, arrays)
        if any(name.startswith("['history']") for name in arrays):
            there = {
                name: value
                for name, value in _OUTCOME._asdict().items()
                if any(one.startswith(f"['history'].outcome.{name}") for one in arrays)
            }
            row = Evaluated(0, np.zeros(0), 0.0, 0.0, Outcome(**there), False)
            whole = _tree("history", row, arrays)
            count = len(whole.z)
            plain["history"] = [
                jax.tree.map(lambda leaf, k=k: _plain(leaf[k]), whole) for k in range(count)
            ]
    except KeyError as error:
        raise RunError(
            f"{folder / STATE}: cannot be read, {error} is missing: it is damaged, or of another "
            "version of jcontour; run it again"
        ) from None
    return TuneState(**plain)


def _tree(name: str, like: Any, arrays: dict[str, np.ndarray]) -> Any:
    """A stored tree of the structure of another."""
    paths, structure = jax.tree_util.tree_flatten_with_path({name: like})
    leaves = [_plain(arrays[jax.tree_util.keystr(path)]) for path, _ in paths]
    return jax.tree.unflatten(structure, leaves)[name]


def _plain(value: np.ndarray) -> Any:
    """The array, or the number that it holds."""
    return value.item() if value.ndim == 0 else value


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise RunError(f"{path}: cannot be read ({error})") from None


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
            self._count(_arrays(path))

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
