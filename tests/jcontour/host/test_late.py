import numpy as np

from jcontour.geometry.contours import circle
from jcontour.host.controller import HostController, StepReport
from jcontour.host.late import OneSampleLate
from jcontour.motion.references import along
from jcontour.plants.xy_table import xy_table


class Counting(HostController):
    """Its control is the number of the sample, from one on."""

    preview = 0

    def prepare(self, reference):
        return None

    def initial_memory(self, reference):
        return 0

    def step(self, memory, plan, measurement):
        assert measurement.size == 3 and np.all(measurement[1:] == memory)
        return memory + 1, np.full(2, memory + 1.0), StepReport()


def test_one_sample_late_is_late_by_one_sample():
    machine = xy_table(4e-3)
    late = OneSampleLate(Counting(), machine)
    memory = late.initial_memory(along(circle(1e-2), np.zeros(5), machine.dt, 0, at_rest=True))
    acted = []
    for _ in range(5):
        memory, control, _ = late.step(memory, None, np.zeros(1))
        acted.append(control[0])
    assert acted == [0, 1, 2, 3, 4]
