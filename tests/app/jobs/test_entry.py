"""Samples behind the entry, and a tool that has caught up by then."""

import numpy as np
import pytest

from jcontour import simulate
from jcontour.app.jobs.entry import ENTRY, behind_entry


@pytest.mark.parametrize(
    ("samples", "entry"), [(1000, 100), (201, 100), (200, 100), (199, 99), (2, 1), (1, 0)]
)
def test_the_entry_is_a_hundred_samples_or_half_of_the_run(samples, entry):
    np.testing.assert_array_equal(np.flatnonzero(behind_entry(samples)), range(entry, samples))


@pytest.mark.parametrize("name", ["contouring-lq", "preview-lq"])
def test_behind_the_entry_the_first_lap_is_the_second_one(name, closed_loop):
    """How far the tool is from its place on a circle of 251 samples, lap by lap."""
    plants, controller, reference = closed_loop(name)
    lap = 251
    followed = reference(2 * lap)
    output = np.asarray(simulate(plants[0], controller, followed).output)
    error = output[: 2 * lap] - np.asarray(followed.position)[: 2 * lap]
    radial = np.linalg.norm(error, axis=1)
    apart = np.abs(radial[:lap] - radial[lap:]) / radial[lap:].max()
    assert apart[:ENTRY].max() > 0.1 and apart[ENTRY:].max() < 0.05
