"""Cells of gains: never exceeded between their corners, and close where they are small."""

import numpy as np
import pytest

from jcontour.bounds.disturbed_loop import DisturbedLoop
from jcontour.bounds.gains.gain_cells import GainCell, TooWide, cell_peaks, remainder
from jcontour.bounds.gains.gained_loops import gained
from jcontour.bounds.peak_bounds import peak_bounds

SIZE = np.array([0.5, 0.2, 0.1])


def driven(seed, steps=30):
    """A loop of two controls and one measured number that changes with time, and its run."""
    random = np.random.default_rng(seed)
    M = 0.3 * random.standard_normal((steps, 4, 4))
    E, C = random.standard_normal((steps, 4, 3)), random.standard_normal((steps, 2, 4))
    K, D = 0.3 * random.standard_normal((steps, 2, 4)), 0.1 * random.standard_normal((steps, 2, 1))
    output, control = random.standard_normal((2, steps, 2))
    return DisturbedLoop(M, E, C, K, D, output, control)


def exact(loop, gains, middle):
    """Deviations of a member from a middle's run, and its controls; by its own peak bounds."""
    found = gained(loop, gains)
    direct = np.concatenate([np.zeros((30, 2, 2)), found.D], axis=2)
    tool = np.abs(found.output - middle.output) + peak_bounds(found, found.C, SIZE).bound
    control = np.abs(found.control) + peak_bounds(found, found.K, SIZE, direct).bound
    return tool, control


def peaks(loop, cell):
    middle = gained(loop, cell.middle)
    basis = np.broadcast_to(np.eye(2), (30, 2, 2))
    return cell_peaks(loop, cell, middle, basis, SIZE), middle


def test_no_member_between_the_corners_exceeds_its_cell():
    loop, random = driven(0), np.random.default_rng(1)
    cell = GainCell(np.array([0.9, 1.0]), np.array([1.1, 1.2]))
    found, middle = peaks(loop, cell)
    for gains in random.uniform(cell.low, cell.high, (6, 2)):
        tool, control = exact(loop, gains, middle)
        assert np.all(tool <= found.tool) and np.all(control <= found.control)
    corners = [exact(loop, gains, middle)[0] for gains in cell.corners]
    assert found.corners == pytest.approx(np.array(corners), rel=1e-12)


def test_what_is_between_covers_the_second_difference_and_is_no_multiple_of_it():
    """One control, at the middle: e(0) - (e(h) + e(-h)) / 2 is nearly all of h^2 e'' / 2."""
    loop, h = driven(2), 0.02
    cell = GainCell(np.array([1 - h, 1.0]), np.array([1 + h, 1.0]))
    found, middle = peaks(loop, cell)
    rows, at = np.asarray(loop.C), 20
    kernels = []
    for gains in (np.ones(2), *cell.corners):
        one = gained(loop, gains)
        found_kernel, row = [], rows[at]
        for j in range(at - 1, -1, -1):
            found_kernel.append(row @ np.asarray(one.E)[j])
            row = row @ np.asarray(one.M)[j]
        kernels.append(np.array(found_kernel))
    bend = np.abs(kernels[0] - (kernels[1] + kernels[2]) / 2)  # (j, row, disturbance)
    largest = np.einsum("jrd,d->r", bend, SIZE)
    assert np.all(largest <= found.between[at])
    assert np.all(found.between[at] < 100 * largest)
    wide = peaks(loop, GainCell(np.array([1 - 2 * h, 1.0]), np.array([1 + 2 * h, 1.0])))[0]
    ratio = wide.between[5:] / found.between[5:]
    assert np.all((ratio > 3.9) & (ratio < 6.0))  # h^2, and a little more for the sums


def test_what_is_left_between_the_corners_is_the_series_by_hand():
    """A control answers a force by a in the next sample alone, of any size: a series of a h.

    Its second derivative by the gain is 2 a^2 u / (1 - a h)^3 at most: h^2 / 2 of that.
    """
    T, a, h, one = 60, 0.5, 0.3, np.ones((60, 1, 1))
    flat = np.ones((T, 1))
    loop = DisturbedLoop(0 * one, one, one, a * one, np.zeros((T, 1, 0)), flat, flat)
    found = remainder(loop, np.array([h]), np.asarray(loop.K), np.zeros(1))
    assert found[-1] == pytest.approx([h**2 * a**2 / (1 - a * h) ** 3], rel=1e-3)


def test_a_cell_whose_sums_do_not_close_is_told():
    with pytest.raises(TooWide, match="times too wide"):
        peaks(driven(0), GainCell(np.array([0.1, 0.1]), np.array([3.0, 3.0])))
