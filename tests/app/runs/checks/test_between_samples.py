"""Swings between samples, of a control that alternates."""

import numpy as np

from jcontour.app.runs.checks.between_samples import swing_warnings
from tests.app import small_runs
from tests.canonical import DT

SAMPLES, ERROR = 12, 1e-6
MACHINE = small_runs.machine(encoder_resolution=0.2 * ERROR)
HIDDEN = MACHINE.hidden_acceleration[1, 1]


def seen(amplitude, lost=False):
    """One contour on two plants; the control of the second one alternates."""
    numbers = {"diverged": np.array([[False, lost]]), "rms_contour_error": np.array([[0.0, ERROR]])}
    found = small_runs.replay(SAMPLES, **numbers)
    found.control[0, 1, :, 1] = amplitude * (-1.0) ** np.arange(SAMPLES)
    return found


EVERY = np.ones(SAMPLES, bool)


def warnings(replay, counted=EVERY, machine=MACHINE):
    position = np.zeros((1, SAMPLES, 2))
    found = small_runs.scenarios([small_runs.job("ring", counted)], position, counted[None])
    return swing_warnings(replay, found, machine)


def test_a_swing_of_much_of_the_error_is_told():
    """RMS of the fine samples of a parabola, a quarter of the error."""
    arc = 4 * (t := np.linspace(0, 1, 10_001)) * (1 - t)
    height = 0.25 * ERROR / np.sqrt(np.mean(arc**2))
    [told] = warnings(seen(height / (HIDDEN * DT**2 / 8)))
    assert told.startswith(
        f"Y swings by 0.25 um RMS between samples, and by up to {1e6 * height:.3g} um, beside an "
        "RMS contour error of 1 um at samples (ring, late)"
    )


def test_a_small_one_is_not():
    assert warnings(seen(0.2 * ERROR / (HIDDEN * DT**2 / 8))) == []


def test_one_within_a_count_is_not():
    coarse = small_runs.machine(encoder_resolution=np.array([1e-9, 0.6 * ERROR]))
    replay = seen(0.5 * ERROR / (HIDDEN * DT**2 / 8))
    assert warnings(replay) and not warnings(replay, machine=coarse)


def test_only_scored_samples_count():
    replay = seen(0.5 * ERROR / (HIDDEN * DT**2 / 8))
    assert warnings(replay, SCORED := np.arange(SAMPLES) >= 4)
    replay.control[0, 1, SCORED] = 0.0
    assert warnings(replay, np.arange(SAMPLES) >= 5) == []


def test_a_run_that_diverged_has_none():
    replay = seen(1e3, lost=True)
    replay.control[0, 1, 5] = np.nan
    assert warnings(replay) == []
