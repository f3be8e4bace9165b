"""Numbers that are lost in a run, told apart from those that grow beyond all bounds."""

import numpy as np
import pytest

from jcontour.app.runs.checks.lost_numbers import lost_numbers
from tests.app import small_runs

SAMPLES = 20
COUNTED = np.ones(SAMPLES, bool)
RING = small_runs.job("ring", COUNTED)
SCENARIOS = small_runs.scenarios([RING], np.zeros((1, SAMPLES, 2)), COUNTED[None])


def run(**lost):
    """One contour on two plants, at rest but for what is given: (plant, sample, axis, value)."""
    found = small_runs.replay(SAMPLES)
    for name, (plant, sample, axis, value) in lost.items():
        getattr(found, name)[0, plant, sample:, axis] = value
    return found


@pytest.mark.parametrize(
    ("lost", "says"),
    [
        (
            {"control": (0, 0, 1, np.nan)},
            "the control is NaN (not a number) from sample 0 (ring, nominal): look",
        ),
        (
            {"control": (0, 7, 0, np.nan), "output": (0, 8, 0, np.nan)},
            "the control is NaN (not a number) from s",
        ),
        (
            {"control": (0, 7, 0, np.nan), "output": (0, 7, 0, np.nan)},
            "the output is NaN (not a number) from s",
        ),
        (
            {"output": (0, SAMPLES - 1, 1, np.nan)},
            f"the output is NaN (not a number) from sample {SAMPLES - 1} ",
        ),
    ],
)
def test_what_is_lost_first_is_named(lost, says):
    (line,) = lost_numbers(run(**lost), SCENARIOS)
    assert line.startswith(says)


@pytest.mark.parametrize(
    "lost",
    [
        {},
        {"control": (1, 3, 0, np.nan)},  # of another plant
        {"control": (0, 3, 0, np.inf)},
        {"control": (0, 3, 0, 1e13), "output": (0, 9, 0, np.nan)},
        {"output": (0, 3, 0, -np.inf), "control": (0, 4, 0, np.nan)},
    ],
)
def test_numbers_that_are_finite_or_grow_are_not(lost):
    assert lost_numbers(run(**lost), SCENARIOS) == []
