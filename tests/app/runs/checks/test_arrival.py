"""A tool that is far from the end of its motion when that ends."""

import numpy as np
import pytest

from jcontour.app.runs.checks.arrival import arrival_warnings, motions_not_followed
from tests.app import small_runs

SAMPLES, PEAK = 101, 2e-6
TO_REST = 1e-3 * (1 - np.cos(np.pi * np.arange(SAMPLES) / (SAMPLES - 1))) / 2
IN_MOTION = 1e-5 * np.arange(SAMPLES)


def told(apart, path=TO_REST, lost=False, scored=True):
    """One contour on two plants; the second one ends so far from the end [m]."""
    position = np.stack([path, np.zeros(SAMPLES)], axis=1)[None]
    output = np.repeat(position[:, None], 2, axis=1)
    output[0, 1, -1, 1] += apart
    numbers = {"diverged": np.array([[False, lost]])}
    numbers["peak_contour_error"] = np.array([[0.5 * PEAK, PEAK]])
    mask = np.full((1, SAMPLES), scored)
    found = small_runs.scenarios([small_runs.job("part", mask[0])], position, mask)
    replay = small_runs.replay(SAMPLES, **numbers)._replace(output=output)
    return arrival_warnings(replay, found)


def test_a_tool_that_has_not_arrived_is_told():
    [line] = told(2.1 * PEAK)
    assert "the tool is still 4.2 um from its end (part, late)" in line


@pytest.mark.parametrize(
    "given",
    [
        {"apart": 1.9 * PEAK},  # as much as the errors on the way
        {"apart": 9 * PEAK, "path": IN_MOTION},  # it goes on
        {"apart": 9 * PEAK, "lost": True},  # told as diverged
        {"apart": 9 * PEAK, "scored": False},  # a rapid move
    ],
)
def test_otherwise_nothing_is_told(given):
    assert told(**given) == []


@pytest.mark.parametrize(("moved", "lines"), [(0.0, 1), (0.49, 1), (0.51, 0), (1.0, 0)])
def test_a_tool_that_moves_less_than_half_of_the_way_does_not_follow(moved, lines):
    """To and fro: the tool ends where it should, also one that rests on the path all the time."""
    path = np.concatenate([TO_REST, TO_REST[::-1]])
    position = np.stack([path, np.zeros(len(path))], axis=1)[None]
    output = np.stack([position, moved * position], axis=1)
    output[0, 0, -1] = np.nan  # lost: told as diverged
    mask = np.ones((1, len(path)), bool)
    job, plants = small_runs.job("part", mask[0]), ("lost", "late")
    found = small_runs.scenarios([job], position, mask, plants=plants)
    told = motions_not_followed(small_runs.replay(len(path))._replace(output=output), found)
    assert len(told) == lines
    assert all(f"moves {2 * moved:.4g} of 2 mm (part, late)" in line for line in told)
