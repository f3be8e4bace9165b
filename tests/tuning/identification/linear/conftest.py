"""A machine of two drives, its record, and what is found from it."""

import numpy as np
import pytest

from jcontour.linear.continuous_axes import speed_axis
from tests.tuning.identification.linear.recorded_axes import RecordedAxis, recorded
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord

DT, ROWS = 1e-3, 8000


def _reference(seed):
    return np.repeat(np.random.default_rng(seed).uniform(-0.01, 0.01, ROWS // 80), 80)


@pytest.fixture(scope="session")
def record():
    signals = []
    for k, (constant, delay) in enumerate(((0.010, 2), (0.015, 3))):
        axis = speed_axis(0.02, constant, delay * DT)
        one = RecordedAxis(axis, "speed", 1e-6, 0.5e-6, 1e-3, (500.0,))
        signals.append(recorded(one, _reference(k), DT, np.random.default_rng(k)))
    u, y = (np.stack(part, axis=1) for part in zip(*signals, strict=True))
    return MachineRecord(DT, ("X", "Y"), u, y)


@pytest.fixture(scope="session")
def found(record):
    """What the first half of the record tells."""
    half = record.command[: ROWS // 2], record.position[: ROWS // 2]
    return identify_machine(MachineRecord(DT, record.axes, *half), 1, 4)
