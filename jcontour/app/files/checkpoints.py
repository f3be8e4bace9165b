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
# stored leaf by leaf; every other field of the state is one number or one array
_TREES = ("history", "descent")
ALONE = ("late", "count_noise")  # of the loops of an outcome: one array each
# its structure
_DESCENT = begin(np.zeros(1), Model(*(np.zeros((1,) * axes) for axes in (2, 1, 3, 2))))


def save_state(folder: Path, state: TuneState) -> Path:
    """Write the state of a run; what was there before stays until the new file is whole."""
    arrays: dict[str, Any] = {
        name: np.asarray(value) for name, value in vars(state).items() if name not in _TREES
    }
    leaves = jax.tree.leaves(state.descent)
    arrays |= {f"descent_{k}": np.asarray(leaf) for k, leaf in enumerate(leaves)}
    rows = state.history
    for name in Evaluated._fields:
        if name != "outcome":
            arrays[f"history_{name}"] = np.asarray([getattr(row, name) for row in rows])
    for name in Metrics.__dataclass_fields__:
        values = [getattr(row.outcome.metrics, name) for row in rows]
        arrays[f"metrics_{name}"] = np.asarray(values)
    for name in LoopPeaks._fields if rows and rows[0].outcome.loops is not None else ():
        arrays[f"loops_{name}"] = np.asarray([getattr(row.outcome.loops, name) for row in rows])
    for name in LimitUse._fields if rows and rows[0].outcome.use is not None else ():
        arrays[f"use_{name}"] = np.asarray([getattr(row.outcome.use, name) for row in rows])
    for name in ALONE:
        if rows and getattr(rows[0].outcome, name) is not None:
            arrays[name] = np.asarray([getattr(row.outcome, name) for row in rows])
    return write(folder / STATE, lambda temporary: np.savez(temporary, **arrays))


def load_state(folder: Path) -> TuneState:
    """State of a run; a fresh one when it has not made its first step.

    Raises:
        RunError: the file is damaged.
    """
    if not (folder / STATE).exists():
        return TuneState()
    try:
        with np.load(folder / STATE, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        descent, structure = None, jax.tree.structure(_DESCENT)
        if "descent_0" in arrays:
            leaves = [_plain(arrays[f"descent_{k}"]) for k in range(structure.num_leaves)]
            descent = jax.tree.unflatten(structure, leaves)
        others = {f.name: arrays[f.name] for f in fields(TuneState) if f.name not in _TREES}
        plain: dict[str, Any] = {name: _plain(value) for name, value in others.items()}
        return TuneState(history=_history(arrays), descent=descent, **plain)
    except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise RunError(f"{folder / STATE}: cannot be read ({error})") from None


def _plain(value: np.ndarray) -> Any:
    """The array, or the number that it holds."""
    return value.item() if value.ndim == 0 else value


def _history(arrays: dict[str, np.ndarray]) -> list[Evaluated]:
    columns = {name: arrays[f"history_{name}"] for name in Evaluated._fields if name != "outcome"}
    metrics = {name: arrays[f"metrics_{name}"] for name in Metrics.__dataclass_fields__}
    looked = "loops_spectral_radius" in arrays
    loops = [arrays[f"loops_{name}"] for name in LoopPeaks._fields] if looked else []
    limited = "use_speed" in arrays
    use = [arrays[f"use_{name}"] for name in LimitUse._fields] if limited else []
    history = []
    for k in range(len(columns["start"])):
        row = Evaluated(
            int(columns["start"][k]),
            columns["z"][k],
            float(columns["objective"][k]),
            float(columns["violation"][k]),
            Outcome(
                Metrics(**{name: values[k] for name, values in metrics.items()}),
                LoopPeaks(*(values[k] for values in loops)) if looked else None,
                LimitUse(*(values[k] for values in use)) if limited else None,
                **{name: arrays[name][k] for name in ALONE if name in arrays},
            ),
            bool(columns["diverged"][k]),
        )
        history.append(row)
    return history


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
