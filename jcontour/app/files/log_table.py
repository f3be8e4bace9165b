"""Columns of numbers from what drives and programs record: text, netCDF and MAT files."""

import os
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from jcontour.app.files.checks import LARGEST, bytes_of, line
from jcontour.app.files.mat_file import NUMERIC, read_mat

MOST_BYTES = 512 * 2**20
HEAD_BYTES = 2**16  # in which the first numbers begin
SURE_ROWS = 5  # of numbers in a row: the text above them is over
COMMENTS = "#%/"
SEPARATORS = "\t;"
SPACES = r"\s+"
TRACE = b"<traceData"  # in what a SINUMERIK saves of its servo trace
PERIOD = re.compile(r"Sampling period is (\d+) nSec")  # above the samples of LinuxCNC's halscope
KLIPPER = b"time,accel_x,accel_y,accel_z", b"freq,psd_x,psd_y,psd_z"  # heads of its accelerometer
SCOPE = "Name"  # above the times of a TwinCAT scope, in the row that names its channels

Table = dict[str, Float[np.ndarray, " T"]]


def read_table(path: Path) -> Table:
    """Columns of numbers of a file by name, in lower case; NaN where a cell holds none.

    A text file may have tabs, semicolons, commas or spaces between its cells, decimal commas, and
    any text above its header, which may be a comment; without a header columns are 1, 2, ...
    Columns of text are left out, and where names alternate with numbers they name the columns.
    Stamps of date and time become seconds. A column of a netCDF or MAT file is a vector, or a
    column of a matrix: `q` of two columns gives q_1 and q_2; `rec.q` is the field of a struct.
    """
    content = bytes_of(path, MOST_BYTES)
    if path.suffix.lower() == ".mat":
        table = _vectors(read_mat(path))
    elif path.suffix.lower() in (".nc", ".h5", ".hdf5"):
        table = _vectors(_netcdf(path))
    elif TRACE in content:
        table = _trace(path, content)
    else:
        table = _text(path, content)
    if not table:
        raise ValueError(f"{path}: holds no column of numbers")
    return table


def of_accelerometer(path: Path) -> bool:
    """Whether a file is one that Klipper writes of its accelerometer."""
    if not (path.is_file() and os.access(path, os.R_OK)):
        return False  # who reads the log says why
    with path.open("rb") as file:
        begun = file.read(HEAD_BYTES)
    return any(head in begun for head in KLIPPER)


def finite(path: Path, name: str, values: Float[np.ndarray, " T"], above: int = 0) -> None:
    """Refuse a column that lacks a number, or has one that no machine has."""
    bad = np.flatnonzero(~(np.abs(values) <= LARGEST))
    if bad.size:
        row, what = above + bad[0] + 1, "no number"
        if np.isfinite(values[bad[0]]):
            what = f"{values[bad[0]]:.3g}, more than {LARGEST:g},"
        raise ValueError(f"{path}: column {name} holds {what} in row {row} behind the header")


def _text(path: Path, content: bytes) -> Table:
    if not content.strip():
        raise ValueError(f"{path}: is empty")
    if content[:2] in (BOM_UTF16_LE, BOM_UTF16_BE):
        content = content.decode("utf-16", errors="replace").encode()
    if b"\0" in content[:HEAD_BYTES]:
        raise ValueError(f"{path}: cannot be read as text; export it as CSV")
    encoding = "utf-8-sig"
    try:
        content.decode(encoding)
    except UnicodeDecodeError:
        encoding = "cp1252"
    head = content[:HEAD_BYTES].decode(encoding, errors="replace").splitlines()
    filled, numeric = [k for k, words in enumerate(head) if words.strip()], list[bool]()
    for k in filled:  # whether half of the filled cells of a line are numbers
        cells = [cell for cell in _cells(head[k], _separator(head[k])) if cell]
        count = sum(_is_number(cell.replace(",", ".")) for cell in cells)
        numeric.append(0 < len(cells) <= 2 * count)
    below = [k for j, k in enumerate(filled) if all(numeric[j : j + SURE_ROWS])]
    if not below:
        raise ValueError(f"{path}: holds no rows of numbers")
    first, separator = below[0], _separator(head[below[0]])
    try:
        frame = pd.read_csv(
            BytesIO(content),
            sep=separator,
            header=None,
            skiprows=first,
            skipinitialspace=True,
            skip_blank_lines=False,
            comment="#",
            encoding=encoding,
            encoding_errors="replace",
            low_memory=False,
        )
    except ValueError as error:
        match = re.search(r"Expected (\d+) fields in line (\d+)", str(error))
        what = f"line {match[2]} does not hold {match[1]} cells" if match else line(error)
        raise ValueError(f"{path}: {what}") from None
    frame = frame.dropna(axis=1, how="all").dropna(how="all")
    columns = {int(k): frame[k].to_numpy() for k in frame.columns}
    scope = _scope(head[:first], separator, len(columns))
    if scope:
        columns = _under_scope(path, columns, scope)
        head[first - 1] = separator.join(scope)
    names = _names(path, head[:first], columns, separator)
    numbers = {name: _numbers(columns[k]) for k, name in names.items()}
    if (period := PERIOD.search("".join(head[:first]))) and "time_s" not in numbers:
        numbers["time_s"] = 1e-9 * int(period[1]) * np.arange(len(frame))
    return {name: one for name, one in numbers.items() if np.isfinite(one).any()}


def _scope(above: list[str], separator: str, count: int) -> list[str]:
    """Names in an export of TwinCAT's scope, its times as time_ms; none of another file."""
    if not any(words.startswith("SampleTime") for words in above):
        return []
    rows = (_cells(words, separator) for words in above)
    heads = next((one for one in rows if one[:1] == [SCOPE] and len(one) >= count), [])
    marks = [k for k, cell in enumerate(heads) if cell == SCOPE]
    times = {k: f"time_ms_{j}" if j else "time_ms" for j, k in enumerate(marks)}
    return [times.get(k, cell) for k, cell in enumerate(heads)]


def _under_scope(
    path: Path, columns: dict[int, np.ndarray], heads: list[str]
) -> dict[int, np.ndarray]:
    """Rows of samples; channels of several rates, each with its times, are refused."""
    stamped = [k for k, name in enumerate(heads) if name.startswith("time_ms") and k in columns]
    words = np.array([[str(cell) for cell in columns[k]] for k in stamped], dtype=str)
    times = pd.DataFrame(np.char.replace(words, ",", ".")).T
    stamps = times.apply(pd.to_numeric, errors="coerce").to_numpy()
    rows = np.isfinite(stamps).any(axis=-1)
    if not rows.any():
        raise ValueError(f"{path}: holds no samples below the names of its channels")
    if np.any(stamps[rows] != stamps[rows][:, :1]):
        raise ValueError(f"{path}: its channels have several rates; export those of one rate alone")
    return {k: column[rows] for k, column in columns.items()}


def _separator(words: str) -> str:
    """What stands between the cells of a line; in 0,1 0,2 it is the space."""
    for one in SEPARATORS:
        if one in words.strip():
            return one
    cells = words.split()
    if "," not in words or (len(cells) > 1 and not re.search(r",\S*,|,\s|,$", words)):
        return SPACES
    return ","


def _cells(words: str, separator: str) -> list[str]:
    """Cells of a line, without empty ones at its end."""
    words = words.strip(" \r\n")
    cells = words.split() if separator == SPACES else words.split(separator)
    while cells and not cells[-1].strip():
        cells.pop()
    return [cell.strip().strip('"') for cell in cells]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(column: np.ndarray) -> Float[np.ndarray, " T"]:
    """A column as numbers, seconds where it holds stamps of time; all NaN for one of text."""
    if column.dtype.kind in NUMERIC:
        return column.astype(float)
    points = pd.Series([str(cell).strip().replace(",", ".") for cell in column])
    numbers = np.asarray(pd.to_numeric(points, errors="coerce"), float)
    if np.isfinite(numbers).mean() >= 0.5:
        return numbers
    stamps = pd.to_datetime(points, format="ISO8601", errors="coerce", utc=True)
    if stamps.isna().all():  # no dates; of the time of day
        stamps = pd.to_timedelta(points.where(points.str.contains(":")), errors="coerce")
    return (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy()


def _names(
    path: Path, above: list[str], columns: dict[int, np.ndarray], separator: str
) -> dict[int, str]:
    """Names of the columns: from the last line above, or from text that stands before each."""
    texts = []  # columns of one text that is no number
    for k, column in columns.items():
        text = isinstance(column[0], str) and not _is_number(column[0].replace(",", "."))
        if text and (column == column[0]).all():
            texts.append(k)
    if texts and list(columns)[::2] == texts:
        return dict(zip(list(columns)[1::2], [columns[k][0].lower() for k in texts], strict=False))
    filled = [words for words in above if words.strip()]
    heads = _cells(filled[-1].lstrip(COMMENTS), separator) if filled else []
    named = len(heads) >= len(columns)
    names = {k: (heads[k].lower() if named else "") or str(k + 1) for k in columns}
    if len(set(names.values())) < len(names):
        raise ValueError(f"{path}: two columns have the same name; has {', '.join(names.values())}")
    return names


def _trace(path: Path, content: bytes) -> Table:
    """Signals of a SINUMERIK's servo trace by the names that its display gives them."""

    def rows(tag: str) -> pd.DataFrame:
        return pd.read_xml(BytesIO(content), xpath=f".//{tag}", attrs_only=True, parser="etree")

    try:
        frame, kept, named = rows("rec"), rows("dataSignal"), rows("signal")
        keys = dict(zip(kept["id"], kept["key"], strict=True))
        words = dict(zip(named["key"], named["name"], strict=True))
        heads = {one: str(words.get(keys.get(one), one)).lower() for one in frame}
        if len(set(heads.values())) < len(heads):
            raise ValueError("two of its signals have the same name")
    except (ValueError, KeyError, SyntaxError) as error:
        raise ValueError(f"{path}: not a readable trace of a SINUMERIK ({line(error)})") from None
    numbers = {heads[one]: _numbers(frame[one].to_numpy()) for one in frame}
    return {"time_s" if name == "time" else name: column for name, column in numbers.items()}


def _netcdf(path: Path) -> dict[str, np.ndarray]:
    import xarray as xr

    try:
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as dataset:
            return {str(name): np.asarray(dataset[name]) for name in dataset.variables}
    except Exception as error:  # a damaged file fails in many ways
        raise ValueError(f"{path}: not a readable netCDF file ({line(error)})") from None


def _vectors(arrays: dict[str, np.ndarray]) -> Table:
    """Every vector, and every column of a matrix longer than wide, that holds numbers."""
    table: Table = {}
    for name, values in arrays.items():
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
