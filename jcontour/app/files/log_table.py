"""Columns of numbers from what drives and programs record: CSV, netCDF and MAT files.

SciPy reads MAT files in a process of its own: on some damaged files its reader ends the process.
"""

import csv
import pickle
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour.app.files.checks import line
from jcontour.regular_files import content_of

MOST_BYTES = 512 * 2**20
COMMENTS = ("#", "%", "//")
SEPARATORS = "\t;,"
NUMBERS = re.compile(r"(?:[\d\s.,;+-]|e|nan|inf)+", re.IGNORECASE)  # a line of nothing else

Table = dict[str, Float[np.ndarray, " T"]]
NUMERIC = "fiu"  # kinds of arrays that are columns; text and cells are none


def read_table(path: Path) -> Table:
    """Columns of a file by name, in lower case; those of a CSV without header are 1, 2, ...

    The header is the last line before two lines of numbers; text above it is left out.
    In place of commas a text file may have tabs, semicolons or spaces, any number of these.
    A column of a netCDF or MAT file is a vector, or a column of a matrix: `q` of two columns gives
    q_1 and q_2.

    Raises:
        ValueError: the file cannot be read, holds no column of numbers, or a line is not like the
            others; the line is named.
    """
    try:
        content = content_of(path, MOST_BYTES)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror or error})") from None
    if path.suffix.lower() == ".mat":
        table = _vectors(read_mat(path))
    elif path.suffix.lower() in (".nc", ".h5", ".hdf5"):
        table = _vectors(_netcdf(path))
    else:
        table = _csv(path, content)
    if not table:
        raise ValueError(f"{path}: holds no column of numbers")
    return table


def _csv(path: Path, content: bytes) -> Table:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: cannot be read as text; export it as CSV") from None
    lines = [
        (number, words)
        for number, words in enumerate(text.splitlines(), 1)
        if words.strip() and not words.lstrip().startswith(COMMENTS)
    ]
    if not lines:
        raise ValueError(f"{path}: is empty")
    lines = _from_header(lines)
    separator = max(SEPARATORS, key=lambda one: lines[0][1].count(one))
    comma = separator != ","  # then it may stand in numbers, as in 0,001
    texts = [words for _, words in lines]
    if separator in texts[0]:
        rows = list(csv.reader(texts, delimiter=separator, skipinitialspace=True))
    else:
        rows = [words.split() for words in texts]
    named = not all(_is_number(word, comma) for word in rows[0])
    heads = [word.strip().lower() for word in rows[0]] if named else []
    heads = heads or [str(k + 1) for k in range(len(rows[0]))]
    if len(set(heads)) < len(heads):
        raise ValueError(f"{path}: two columns have the same name; has {', '.join(heads)}")
    numbers = np.empty((len(rows) - named, len(heads)))
    for k, cells in enumerate(rows[named:]):
        try:
            numbers[k] = np.array([_number(cell, comma) for cell in cells]).reshape(len(heads))
        except ValueError:
            place = lines[k + named][0]
            head = f" as the header, line {lines[0][0]}" if named else ""
            raise ValueError(
                f"{path}: line {place} does not hold {len(heads)} numbers{head}"
            ) from None
    return {name: numbers[:, k].copy() for k, name in enumerate(heads)}


def _from_header(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Numbered lines without the text above the header, the last line before those of numbers."""
    for k, ((_, first), (_, second)) in enumerate(pairwise(lines)):
        if NUMBERS.fullmatch(first) and NUMBERS.fullmatch(second):
            return lines[max(k - 1, 0) :]
    return lines


def _number(word: str, comma: bool) -> float:
    return float(word.replace(",", ".") if comma else word)


def _is_number(word: str, comma: bool) -> bool:
    try:
        _number(word, comma)
    except ValueError:
        return False
    return True


def _netcdf(path: Path) -> dict[str, np.ndarray]:
    import xarray as xr

    try:
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as dataset:
            return {str(name): np.asarray(dataset[name]) for name in dataset.variables}
    except Exception as error:  # a damaged file fails in many ways
        raise ValueError(f"{path}: not a readable netCDF file ({line(error)})") from None


def _vectors(found: dict[str, np.ndarray]) -> Table:
    """Every vector, and every column of a matrix longer than wide, that holds numbers."""
    table: Table = {}
    for name, values in found.items():
        array = np.squeeze(np.asarray(values))
        if array.dtype.kind not in NUMERIC or array.ndim not in (1, 2) or array.shape[0] < 2:
            continue
        if array.ndim == 1:
            table[name.lower()] = array.astype(float)
        else:
            long = array if array.shape[0] >= array.shape[1] else array.T
            for k in range(long.shape[1]):
                table[f"{name.lower()}_{k + 1}"] = long[:, k].astype(float)
    return table


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
