"""Swings between samples, of a control that alternates."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from experiments.jobs.replays import Replay, Scenarios
from experiments.runs.checks.between_samples import swing_warnings

DT, SAMPLES, HIDDEN, ERROR = 2e-3, 12, 0.8, 1e-6
MACHINE = cast(
    Any,
    SimpleNamespace(
        axes=("X", "Y"),
        error="contour",
        model=SimpleNamespace(dt=DT),
        hidden_acceleration=np.diag([0.0, HIDDEN]),
    ),
)


def seen(amplitude, lost=False):
    """One contour on two plants; the control of the second one alternates."""
    control = np.zeros((1, 2, SAMPLES, 2))
    control[0, 1] = amplitude * (-1.0) ** np.arange(SAMPLES)[:, None]
    metrics = SimpleNamespace(
        diverged=np.array([[False, lost]]), rms_contour_error=np.array([[0.0, ERROR]])
    )
    return Replay(cast(Any, metrics), np.zeros_like(control), control, control)


def warnings(replay):
    references = SimpleNamespace(mask=np.ones((1, SAMPLES), bool), steps=SAMPLES)
    jobs = (SimpleNamespace(name="ring"),)
    found = Scenarios(cast(Any, jobs), (True,), ("nominal", "late"), cast(Any, references), 0)
    return swing_warnings(replay, found, MACHINE)


def test_a_swing_of_much_of_the_error_is_told():
    aside = HIDDEN * DT**2 / 8  # [m] for each unit
    [told] = warnings(seen(0.25 * ERROR / aside))
    assert told.startswith(
        "Y swings by up to 0.25 um between samples, beside an RMS contour error of 1 um at samples "
        "(ring, late)"
    )


def test_a_small_one_is_not():
    assert warnings(seen(0.09 * ERROR / (HIDDEN * DT**2 / 8))) == []


def test_a_run_that_diverged_has_none():
    replay = seen(1e3, lost=True)
    replay.control[0, 1, 5] = np.nan
    assert warnings(replay) == []
