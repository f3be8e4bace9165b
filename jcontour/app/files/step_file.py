"""Step responses: columns time, control, position; by name or in this order.

Time is in seconds, or in what suits a drive where seconds are impossible.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.app.files.checks import METRES
from jcontour.app.files.clock import SECONDS, even_period, likely_unit
from jcontour.app.files.log_table import finite, read_table

NAMES = ("time", "control", "position")


class StepRecord(NamedTuple):
    """A record of one axis.

    Attributes:
        dt: sample period [s].
        control: [control unit].
        position: [m].
        unit: of the file's times.
    """

    dt: float
    control: Float[np.ndarray, " T"]
    position: Float[np.ndarray, " T"]
    unit: str = "s"


def read_step(path: Path, length_unit: str) -> StepRecord:
    """Record of a file whose positions are in a unit: m, mm or um.

    Raises:
        ValueError: the file cannot be read, a column is missing or no number, or the samples are
            not evenly spaced.
    """
    table = read_table(path)
    if list(table) == ["1", "2", "3"]:
        table = dict(zip(NAMES, table.values(), strict=True))
    missing = [name for name in NAMES if name not in table]
    if missing:
        raise ValueError(
            f"{path}: has no column {missing[0]!r}; needs {', '.join(NAMES)}, has "
            f"{', '.join(table)}"
        )
    for name in NAMES:
        finite(path, name, table[name])
    time, control, position = (table[name] for name in NAMES)
    unit = likely_unit(time)
    try:
        dt = even_period(SECONDS[unit] * time)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return StepRecord(dt, control, METRES[length_unit] * position, unit)
