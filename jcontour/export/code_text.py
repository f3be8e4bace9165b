"""Numbers, tables and comments as the text of a program."""

import re
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

Precision = Literal["double", "single"]
COLUMNS = 100  # of a line of code


def literal(value: float, precision: Precision = "double") -> str:
    """A number that reads back to the last bit; always with a point, as structured text asks.

    >>> literal(1e-5), literal(2.0), literal(0.1, "single")
    ('1.0e-05', '2.0', '0.1f')

    Raises:
        ValueError: it is not finite.
    """
    if not np.isfinite(value):
        raise ValueError(f"a table for a drive needs finite numbers, received {value}")
    text = str(np.float32(value)) if precision == "single" else repr(float(value))
    mantissa, e, exponent = text.partition("e")
    point = "" if "." in mantissa else ".0"
    return f"{mantissa}{point}{e}{exponent}{'f' if precision == 'single' else ''}"


def table(values: Float[np.ndarray, "..."], precision: Precision = "double") -> str:
    """All numbers of an array with commas, a line for each row of its last axis."""
    rows = np.reshape(values, (-1, np.shape(values)[-1]))
    return ",\n".join(_row([literal(value, precision) for value in row]) for row in rows)


def _row(words: Sequence[str]) -> str:
    lines, line = [], "   "
    for k, word in enumerate(words):
        word = word if k == len(words) - 1 else f"{word},"
        if len(line) + len(word) + 1 > COLUMNS:
            lines.append(line)
            line = "   "
        line += f" {word}"
    return "\n".join([*lines, line])


def heading(name: str, unit: str, per: str | None = None) -> str:
    """Name of a CSV column that ends in its unit.

    >>> heading("f1", "N/kg"), heading("F1", "control unit", per="state 1")
    ('f1_N_per_kg', 'F1_control_unit_per_state_1')
    """
    text = unit if per is None else f"{unit}/{per}"
    return f"{name}_" + re.sub(r"[^\w%]+", "_", text.replace("/", "_per_"))


def plain(line: str) -> str:
    """One line of ASCII that neither ends a comment of C or structured text nor begins one."""
    words = " ".join(line.split()).encode("ascii", "replace").decode()
    for mark in ("*/", "/*", "*)", "(*"):
        words = words.replace(mark, " ".join(mark))
    return words.rstrip("\\").replace("??/", "? ? /")
