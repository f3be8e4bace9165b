"""A machine of another program than ours: what is stated of its response holds."""

import numpy as np
import pytest

from experiments.benchmarks.records.hidden_machines import LIMITS
from jcontour.app.jobs.excitation import sines
from jcontour.app.machines.identified import machine_fields
from tests.experiments.benchmarks.records.two_masses import TwoMasses
from tuning.identification.linear.found import MachineRecord
from tuning.identification.linear.machine import identify_machine

DT, ROWS = 1e-3, 6_000
MACHINE = TwoMasses(60.0, 30.0, 55.0, 0.02, 8e-6, (40.0, 20.0), 150.0, 35.0, 1.4e-3)


def test_friction_is_near_and_tuned_loops_bear_the_true_response():
    time = DT * np.arange(ROWS // 2)
    moves = 0.02 * np.sin(2 * np.pi * 0.3 * time) + 0.004 * np.sin(2 * np.pi * 1.7 * time)
    asked = np.concatenate([sines(LIMITS)[: ROWS // 2, 0], moves])
    u, y = MACHINE.recorded(asked, DT, (7.0, 90.0), 0)
    found = identify_machine(MachineRecord(DT, ("X",), u[:, None], y[:, None]), 3, 3).twice("Y")
    axis = found.axes[0]
    assert axis.friction is not None
    assert axis.friction[0] == pytest.approx(60.0 / 35.0, rel=0.05)
    fields = machine_fields(found, "two masses", "A")["uncertainty"]["response"]
    hertz, stated = np.array(fields["hertz"]), np.array(fields["relative"])[0]
    inside = (hertz > 2) & (hertz < 200)
    held = MACHINE.response(hertz) * np.exp(-1j * np.pi * hertz * DT) * np.sinc(hertz * DT)
    off = np.abs(held / axis.fit.model.response(2 * np.pi * hertz) - 1)
    assert np.all(off[inside] <= 2 * stated[inside] + 0.01)  # what tuned loops bear
