"""Tolerance of one axis: the reference's numbers, an independent peak, and refused machines."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.linear.plant import LinearPlant
from jcontour.mpc.axis_tolerances import (
    DriveLimits,
    Motion,
    axis_tolerance,
)
from jcontour.mpc.knowledge import Knowledge, state_bounded_by_filter, state_known
from jcontour.sets.least_peaks import NoResponse

DATA = Path(__file__).parents[2] / "data" / "guarantees"
STILL = Motion(speed=0.0, acceleration=0.0, previewed=True)
DT = 1e-2
COUNT = 1e-6


@pytest.fixture(scope="module")
def slide():
    """A mass of 1 kg, its force in N."""
    return LinearPlant([[1, DT], [0, 1]], [[DT**2 / 2], [DT]], [[1.0, 0.0]], dt=DT)


@pytest.fixture(scope="module")
def gain(slide):
    A, C = np.asarray(slide.A), np.asarray(slide.C)
    B = np.asarray(slide.B)
    P = solve_discrete_are(A.T, C.T, B @ B.T, [[COUNT**2]])
    return P @ C.T / (C @ P @ C.T + COUNT**2)


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


def test_the_filter_gives_a_bound_that_is_kept_and_not_the_least(slide, gain):
    """The peak of the whole loop, filter and responses, from its impulses: l1 norm of each."""
    known = state_bounded_by_filter(slide, gain, 1.0, COUNT)
    found = axis_tolerance(slide, known, DriveLimits(4.0), STILL, 10)
    largest = known.E[0, 0] / gain[0, 0]
    response = found.optimum.response.state[:, 0, 0]  # tool, for an innovation of that size
    A, B, C = (np.asarray(matrix) for matrix in (slide.A, slide.B, slide.C))
    peak = 0.0
    for force, error in ((1.0, 0.0), (0.0, COUNT)):
        e, innovations, left = B[:, 0] * force, [], []
        for sample in range(400):
            noise = error if sample == 0 else 0.0
            innovations.append((C @ e)[0] + noise)
            after = e - gain[:, 0] * innovations[-1]
            left.append((C @ after)[0])
            e = A @ after
        tool = np.convolve(innovations, response)[:400] / largest + left
        peak += np.abs(tool).sum()
    assert 0.3 * found.promised < peak < 0.8 * found.promised


def test_limits_that_are_too_small_come_with_what_would_do(slide):
    with pytest.raises(NoResponse, match="no response of 10 samples keeps them: control") as none:
        axis_tolerance(slide, state_known(slide, 1.0), DriveLimits(0.9), STILL, 10)
    assert none.match(r"just above, the least tolerance is 0\.\d+ mm")
    (needed,) = none.value.needed.values()
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


def test_numbers_that_are_no_proof_are_refused(slide, gain):
    with pytest.raises(ValueError, match="encoder: needs an error of at least zero"):
        state_bounded_by_filter(slide, gain, 1.0, -COUNT)
    with pytest.raises(ValueError, match="load: needs one number"):
        state_bounded_by_filter(slide, gain, -1.0, COUNT)
    with pytest.raises(ValueError, match=r"gain: needs finite numbers of shape \(2, 1\)"):
        state_bounded_by_filter(slide, gain[:, 0], 1.0, COUNT)
    with pytest.raises(ValueError, match="gain: .* received NaN"):
        state_bounded_by_filter(slide, gain * np.nan, 1.0, COUNT)
    with pytest.raises(ValueError, match="gain: the filter is not stable"):
        state_bounded_by_filter(slide, 0 * gain, 1.0, COUNT)
    known = state_known(slide, 1.0)
    for motion in (Motion(-0.1, 1.0, False), Motion(0.1, -1.0, False), Motion(np.nan, 1.0, True)):
        with pytest.raises(ValueError, match="motion: .* needs to be finite, not negative"):
            axis_tolerance(slide, known, DriveLimits(4.0), motion, 10)
    with pytest.raises(ValueError, match="limits: control needs to be above zero"):
        axis_tolerance(slide, known, DriveLimits(np.nan), STILL, 10)
