"""Cases that `jcontour bench lq` times: the operations that are counted, machines of all sizes."""

import numpy as np
import pytest
from jcontour.kernels.dispatch import multiplications

from experiments.benchmarks.speed import lq_cases


def test_the_work_is_counted_from_the_plant():
    case = lq_cases.paper_case(np.dtype("float32"), 20, 4)
    assert case.dtype == np.float32 and case.weights(3, 2).shape == (3, 5)
    assert lq_cases.work(case) == 2 * 20 * 4 * multiplications(case.plant.pattern)


@pytest.mark.parametrize("states", lq_cases.SIZES)
def test_machines_of_other_sizes_come_to_rest(states):
    plant = lq_cases.machine(states)
    assert plant.states == sum(states) and plant.axes == plant.inputs == len(states)
    poles = np.sort(np.abs(np.linalg.eigvals(plant.A)))[::-1]
    assert poles[: len(states)] == pytest.approx(1.0)  # a drive's position stays where it is
    assert poles[len(states)] < 0.99
