"""Multisines of a real two-inertia bench (FdiTools, University of Tokyo): 20 periods of 1 s."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from tuning.identification.linear.axis_model import two_masses
from tuning.identification.linear.nonparametric import periodic_lines
from tuning.identification.linear.output_error import AxisRecord
from tuning.identification.linear.vector_fitting import fitted_to

RECORD = "shared/data/records/motor_bench/MultisineTypeA.mat"
DT, EXCITED = 4e-4, (11.0, 250.0)
MOTOR, LOAD, STIFFNESS = 5.01e-3, 4.90e-3, 567.0  # [kg m^2], [Nm/rad], of its authors


@pytest.fixture(scope="module")
def record():
    path = Path(__file__).parents[5] / RECORD
    if not path.exists():
        pytest.skip(f"{RECORD} is not beside the project")
    data = loadmat(path, squeeze_me=True)
    return AxisRecord(DT, data["iq_refx"].astype(float), data["theta_mx"].astype(float))


def test_every_excited_line_is_shown_no_other_and_its_interval_holds(record):
    """Of the first ten periods, against the mean of the others."""
    half = len(record.command) // 2
    one, other = (periodic_lines(record.part(*ends)) for ends in ((0, half), (half, 2 * half)))
    assert (one.frequency[0], one.frequency[-1]) == EXCITED and len(one.frequency) == 240
    np.testing.assert_array_equal(one.frequency, other.frequency)
    off = np.abs(other.value / one.value - 1)
    assert np.mean(off <= np.hypot(one.half_width, other.half_width)) >= 0.95


def test_the_inertias_and_the_spring_are_those_of_the_bench(record):
    """For the torque of one ampere, which the record does not state, that gives their sum."""
    model = fitted_to(periodic_lines(record), DT, 4, 6)
    one = two_masses(model, 1.0)
    assert one is not None
    torque = (MOTOR + LOAD) / (one.motor + one.load)
    assert two_masses(model, torque) == pytest.approx((MOTOR, LOAD, STIFFNESS), rel=0.03)
    assert 2 * model.delay + 1 in (3, 5)  # 0.60 ms beside the sample of the hold
