import numpy as np

from jcontour.geometry.contours import circle
from jcontour.host.controller import HostController, StepReport
from jcontour.host.held import OneSampleLate
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
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

    def finished(self, memory):
        return memory == 5


def test_one_sample_late_is_late_by_one_sample():
    machine = xy_table(4e-3)
    late = OneSampleLate(Counting(), machine)
    memory = late.initial_memory(along(circle(1e-2), np.zeros(5), machine.dt, 0, at_rest=True))
    acted = []
    for _ in range(5):
        memory, control, _ = late.step(memory, None, np.zeros(1))
        acted.append(control[0])
    assert acted == [0, 1, 2, 3, 4] and late.finished(memory)
    assert late.soft_step(memory, None, np.zeros(1)) is None  # there is none inside


def test_drives_that_take_a_position_are_held_where_the_run_begins():
    """y = 2 u at rest: half of the place is on its way, and is what the controller is told."""
    drives = LinearPlant(np.diag([0.9, 0.8]), np.diag([0.2, 0.4]), np.eye(2), 1e-3)
    model = with_input_delay(drives, 1)
    path = along(circle(1e-2), np.zeros(5), model.dt, 0, at_rest=True)
    late = OneSampleLate(Counting(), model)
    waiting = late.initial_memory(path).waiting
    np.testing.assert_allclose(waiting, np.asarray(path.position[0]) / 2, rtol=1e-12, atol=1e-15)
    assert np.any(waiting != 0)
    state = np.asarray(model.initial_state(path.position[0], np.zeros(2)))
    np.testing.assert_allclose(late.enter(late.initial_memory(path), state[:2]), state, rtol=1e-12)
