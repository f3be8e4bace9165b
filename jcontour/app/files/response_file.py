"""Measured frequency responses: a table, or the XML of a SINUMERIK's servo tuning.

The columns of a table are frequency [Hz], then real and imaginary parts, or size [dB] and phase
[deg], and the coherence where there is one. In the XML, numbers of eight bytes stand in base 85,
big-endian, with a point for four bytes of zeros.
"""

import base64
import re
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour._regular_files import content_of
from jcontour.app.files.log_table import MOST_BYTES, Table, finite, read_table
from tuning.response_loop import MeasuredResponse

DIGITS = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
RFC_1924 = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;<=>?@^_`{|}~"
ARRAY = re.compile(r'<raw name="m_pNumberArray"><!\[CDATA\[(.*?)\]\]>', re.DOTALL)
WORDS = {
    "frequency": ("frequency", "freq", "hz", "f"),
    "real": ("real", "re"),
    "imaginary": ("imaginary", "imag", "im"),
    "decibels": ("db", "decibel"),
    "degrees": ("degrees", "degree", "deg", "phase"),
    "coherence": ("coherence", "coh"),
}
FEWEST = 10  # lines


def read_response(path: Path) -> MeasuredResponse:
    """A measured response."""
    columns = _tuned(path) if path.suffix.lower() == ".xml" else _columns(path, read_table(path))
    for name, values in columns.items():
        finite(path, name, values)
    order = np.argsort(columns["frequency"], kind="stable")
    order = order[columns["frequency"][order] > 0]
    if len(order) < FEWEST or (np.diff(columns["frequency"][order]) <= 0).any():
        raise ValueError(
            f"{path}: needs {FEWEST} lines of different frequencies above zero at least"
        )
    if "real" in columns:
        value = columns["real"] + 1j * columns["imaginary"]
    else:
        value = 10 ** (columns["decibels"] / 20) * np.exp(1j * np.radians(columns["degrees"]))
    coherence = columns.get("coherence", np.ones(len(value)))
    return MeasuredResponse(columns["frequency"][order], value[order], coherence[order])


def _columns(path: Path, table: Table) -> dict[str, np.ndarray]:
    """Columns by what they hold; of several of a kind the first."""
    columns = {}
    for name, values in table.items():
        words = re.findall(r"[a-z]+", name)
        for kind, known in WORDS.items():
            if set(known) & set(words):
                columns.setdefault(kind, values)
                break
    if "frequency" not in columns or not (
        {"real", "imaginary"} <= columns.keys() or {"decibels", "degrees"} <= columns.keys()
    ):
        lacks = "phase" if "frequency" in columns and "decibels" in columns else "response"
        raise ValueError(
            f"{path}: has no {lacks}; it needs columns frequency_hz, and real and imaginary or db "
            f"and degrees; has {', '.join(table)}"
        )
    return columns


def _tuned(path: Path) -> dict[str, np.ndarray]:
    """The plant of a speed loop and its coherence, from the XML of an auto servo tuning."""
    text = content_of(path, MOST_BYTES).decode("latin-1")
    arrays = {}
    for name in ("m_pPlant", "m_pMeasCoherence"):
        begin = text.find(f'<FrequencyResponseFunction satclassid="6" name="{name}"')
        end = text.find("</FrequencyResponseFunction>", begin)
        parts = ARRAY.findall(text, begin, end) if begin >= 0 else []
        if len(parts) != 2:
            raise ValueError(f"{path}: holds no measured plant of a servo tuning ({name})")
        arrays[name] = [_doubles(path, part) for part in parts]
    (value, frequency), (coherence, _) = arrays.values()
    return {
        "frequency": frequency,
        "real": value[::2],
        "imaginary": value[1::2],
        "coherence": coherence[::2],
    }


def _doubles(path: Path, text: str) -> Float[np.ndarray, " N"]:
    """Numbers of eight bytes in base 85."""
    words = "".join(text.split()).replace(".", "00000").translate(str.maketrans(DIGITS, RFC_1924))
    if len(words) % 10 == 0:
        with suppress(ValueError):
            return np.frombuffer(base64.b85decode(words), ">f8").astype(float)
    raise ValueError(f"{path}: numbers that are not whole; is the file cut off?")
