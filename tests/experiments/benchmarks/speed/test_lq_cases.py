"""Machines of all sizes that `jcontour bench lq` times."""

import numpy as np
import pytest

from experiments.benchmarks.speed import lq_cases


@pytest.mark.parametrize("states", lq_cases.SIZES)
def test_machines_of_other_sizes_come_to_rest(states):
    plant = lq_cases.machine(states)
    assert plant.states == sum(states) and plant.axes == plant.inputs == len(states)
    poles = np.sort(np.abs(np.linalg.eigvals(plant.A)))[::-1]
    assert poles[: len(states)] == pytest.approx(1.0)  # a drive's position stays where it is
    assert poles[len(states)] < 0.99
