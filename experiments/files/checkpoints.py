"""The state of a tuning run as one npz file, every float to the last bit.

A resumed run so ends as an uninterrupted one.
"""

import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.files.run_folder import RunError, write
from jcontour.simulation.limit_use import LimitUse
from jcontour.simulation.metrics import Metrics
from tuning.outcome import LoopPeaks, Outcome
from tuning.problem import Merit
from tuning.tune import Evaluated, TuneState

STATE = "state.npz"
# stored leaf by leaf; every other field of the state is one number or one array
_TREES = ("history", "memory", "merit")


def save_state(folder: Path, state: TuneState) -> Path:
    """Write the state of a run; what was there before stays until the new file is whole."""
    arrays: dict[str, Any] = {
        name: np.asarray(value) for name, value in vars(state).items() if name not in _TREES
    }
    arrays |= {
        f"memory_{k}": np.asarray(leaf) for k, leaf in enumerate(jax.tree.leaves(state.memory))
    }
    if state.merit is not None:
        arrays |= {
            f"merit_{name}": np.asarray(value) for name, value in state.merit._asdict().items()
        }
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
        return _state(arrays)
    except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise RunError(f"{folder / STATE}: cannot be read ({error})") from None


def _state(arrays: dict[str, np.ndarray]) -> TuneState:
    count = sum(name.startswith("memory_") for name in arrays)
    leaves = [jnp.asarray(arrays[f"memory_{k}"]) for k in range(count)]
    structure = jax.tree.structure(optax.scale_by_lbfgs().init(jnp.zeros(1)))
    memory = jax.tree.unflatten(structure, leaves) if leaves else None
    merit = None
    if "merit_scale" in arrays:  # on the host, as it was
        merit = Merit(*(arrays[f"merit_{name}"] for name in Merit._fields))
    others = {f.name: arrays[f.name] for f in fields(TuneState) if f.name not in _TREES}
    plain: dict[str, Any] = {
        name: value.item() if value.ndim == 0 else value for name, value in others.items()
    }
    return TuneState(history=_history(arrays), memory=memory, merit=merit, **plain)


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
            ),
            bool(columns["diverged"][k]),
        )
        history.append(row)
    return history
