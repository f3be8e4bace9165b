"""Arrays of numbers in a MAT file.

SciPy, or h5py for version 7.3, reads it in a process of its own: on some damaged files it ends.
"""

import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jcontour.app.files.checks import line

NUMERIC = "fiu"  # kinds of arrays that are columns; text and cells are none


def read_mat(path: Path) -> dict[str, np.ndarray]:
    """Arrays of numbers by name, those in a struct as `struct.field`."""
    reader = [sys.executable, "-P", "-m", __name__, str(path)]  # -P: nothing of the folder it is in
    done = subprocess.run(reader, capture_output=True)
    if done.returncode:
        why = done.stderr.decode(errors="replace").strip() if done.returncode == 1 else "damaged"
        raise ValueError(f"{path}: not a readable MAT file ({why})")
    return pickle.loads(done.stdout)


def _numbers(path: str) -> dict[str, np.ndarray]:
    import h5py
    from scipy.io import loadmat

    if not h5py.is_hdf5(path):
        return dict(_fields("", loadmat(path)))
    arrays: dict[str, np.ndarray] = {}

    def keep(name: str, one: Any) -> None:
        kind = getattr(getattr(one, "dtype", None), "kind", "")
        if kind and kind in NUMERIC:
            arrays[name.replace("/", ".")] = one[()]

    with h5py.File(path) as file:  # version 7.3
        file.visititems(keep)
    return arrays


def _fields(above: str, arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays of numbers of a struct and of those inside it, as `rec.position`."""
    for name, values in arrays.items():
        if name.startswith("__") or not isinstance(values, np.ndarray):
            continue
        if values.dtype.kind in NUMERIC:
            yield above + name, values
        elif values.dtype.names:
            for k, one in enumerate(values.flat, 1):  # of several `rec_1`, `rec_2`
                called = f"{above}{name}{f'_{k}' if values.size > 1 else ''}."
                yield from _fields(called, dict(zip(values.dtype.names, one, strict=True)))


if __name__ == "__main__":
    try:
        answer = pickle.dumps(_numbers(sys.argv[1]))
    except Exception as error:  # a damaged file fails in many ways
        sys.exit(line(error))
    sys.stdout.buffer.write(answer)
