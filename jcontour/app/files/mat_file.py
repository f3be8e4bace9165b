"""Arrays of numbers in a MAT file.

SciPy reads it in a process of its own: on some damaged files its reader ends the process.
"""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np

from jcontour.app.files.checks import line

NUMERIC = "fiu"  # kinds of arrays that are columns; text and cells are none


def read_mat(path: Path) -> dict[str, np.ndarray]:
    """Arrays of numbers by name.

    Raises:
        ValueError: SciPy cannot read the file.
    """
    reader = [sys.executable, "-P", "-m", __name__, str(path)]  # -P: nothing of the folder it is in
    done = subprocess.run(reader, capture_output=True)
    if done.returncode:
        why = done.stderr.decode(errors="replace").strip() if done.returncode == 1 else "damaged"
        raise ValueError(f"{path}: not a readable MAT file ({why}); save it as version 7 or older")
    return pickle.loads(done.stdout)


def _numbers(path: str) -> dict[str, np.ndarray]:
    from scipy.io import loadmat

    found = loadmat(path)
    arrays = {name: values for name, values in found.items() if not name.startswith("__")}
    return {name: values for name, values in arrays.items() if values.dtype.kind in NUMERIC}


if __name__ == "__main__":
    try:
        answer = pickle.dumps(_numbers(sys.argv[1]))
    except Exception as error:  # a damaged file fails in many ways
        sys.exit(line(error))
    sys.stdout.buffer.write(answer)
