"""Records of a drive while an axis is commissioned."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Record(NamedTuple):
    """One uninterrupted recording, row k at time k dt; None for what was not recorded.

    Attributes:
        name: of the test.
        dt: [s] between rows.
        motor: position of the motor (T,) [m].
        current: i_q (T,) [A]: what acts from row k to row k + 1, a command that is held or the
            mean; beside a voltage its value at row k.
        tool: position of the end effector (T,) [m].
        voltage: u_q (T,) [V], held from row k to row k + 1.
        current_d: i_d (T,) [A], which the drive keeps at zero.
    """

    name: str
    dt: float
    motor: Float[np.ndarray, " T"]
    current: Float[np.ndarray, " T"]
    tool: Float[np.ndarray, " T"] | None = None
    voltage: Float[np.ndarray, " T"] | None = None
    current_d: Float[np.ndarray, " T"] | None = None

    @property
    def rows(self) -> int:
        """T."""
        return len(self.motor)

    @property
    def duration(self) -> float:
        """[s]."""
        return self.rows * self.dt


def electrical(records: Sequence[Record]) -> list[Record]:
    """Those with a voltage."""
    return [record for record in records if record.voltage is not None]


def mechanical(records: Sequence[Record]) -> list[Record]:
    """Those without: current and positions."""
    return [record for record in records if record.voltage is None]


def with_tool(records: Sequence[Record]) -> list[Record]:
    """Mechanical ones with the end effector."""
    return [record for record in mechanical(records) if record.tool is not None]
