"""Tolerance of one axis: the reference's numbers, an independent peak, and refused machines."""

import json
from pathlib import Path

import numpy as np
import pytest

from jcontour.linear.plant import LinearPlant
from jcontour.mpc.bounded.axis_tolerances import (
    DriveLimits,
    Motion,
    axis_tolerance,
)
from jcontour.mpc.bounded.knowledge import Knowledge, state_known
from jcontour.sets.least_peaks import NoResponse

DATA = Path(__file__).parents[3] / "data" / "guarantees"
STILL = Motion(speed=0.0, acceleration=0.0, previewed=True)
DT = 1e-2


@pytest.fixture(scope="module")
def slide():
    """A mass of 1 kg, its force in N."""
    return LinearPlant([[1, DT], [0, 1]], [[DT**2 / 2], [DT]], [[1.0, 0.0]], dt=DT)


@pytest.mark.parametrize("previewed", [True, False])
def test_the_thesis_axis_has_the_tolerance_of_the_reference(previewed):
    numbers = json.loads((DATA / "axis.json").read_text())
    A, B, E = (np.array(numbers[name]) for name in "ABE")
    plant = LinearPlant(A, B[:, None], [[0, 0, 1.0, 0]], dt=1e-3)
    known = Knowledge(E[:, None], np.zeros(1), np.zeros(1))
    (wanted,) = [
        case["least_tolerance_m"]
        for case in numbers["cases"]
        if case["previewed"] == previewed and case["N"] == 60
    ]
    held = abs(A[1, 1] + A[1, 3] - 1 + (A[3, 1] + A[3, 3] - 1)) / B[1]  # viscous friction
    limits = DriveLimits(control=numbers["bounds"]["u_tilde"] + 0.1 * held, speed=0.25)
    motion = Motion(speed=0.1, acceleration=4.0, previewed=previewed)
    found = axis_tolerance(plant, known, limits, motion, 60)
    assert found.promised == pytest.approx(wanted, rel=1e-2)
    assert found.optimum.limiting == ("control",)


def test_limits_that_are_too_small_come_with_what_would_do(slide):
    with pytest.raises(NoResponse, match="no response of 10 samples keeps them: control") as none:
        axis_tolerance(slide, state_known(slide, 1.0), DriveLimits(0.9), STILL, 10)
    assert none.match(r"just above, the least tolerance is 0\.\d+ mm")
    (needed,) = none.value.needed.values()
    assert none.value.asked == {"control": 0.9}
    enough = DriveLimits(1.01 * needed)
    found = axis_tolerance(slide, state_known(slide, 1.0), enough, STILL, 10)
    assert f"{1e3 * found.promised:.4g} mm" in str(none.value)
    assert found.optimum.limiting == ("control",)


def test_a_motion_that_takes_the_whole_limit_is_said(slide):
    fast = Motion(speed=0.2, acceleration=0.0, previewed=True)
    with pytest.raises(NoResponse, match="speed at most 0.1, motion and disturbances alone take"):
        axis_tolerance(slide, state_known(slide, 1.0), DriveLimits(4.0, speed=0.1), fast, 10)


def test_an_axis_on_a_spring_is_refused():
    stiff = LinearPlant([[1, DT], [-9 * DT, 1]], [[0.0], [DT]], [[1.0, 0.0]], dt=DT)
    with pytest.raises(ValueError, match="plant: no constant control carries the axis on"):
        axis_tolerance(stiff, state_known(stiff, 1.0), DriveLimits(4.0), STILL, 10)


def test_numbers_that_are_no_proof_are_refused(slide):
    known = state_known(slide, 1.0)
    for motion in (Motion(-0.1, 1.0, False), Motion(0.1, -1.0, False), Motion(np.nan, 1.0, True)):
        with pytest.raises(ValueError, match="motion: .* needs to be finite, not negative"):
            axis_tolerance(slide, known, DriveLimits(4.0), motion, 10)
    with pytest.raises(ValueError, match="limits: control needs to be above zero"):
        axis_tolerance(slide, known, DriveLimits(np.nan), STILL, 10)
