"""Limits of a machine that a run comes near or exceeds."""

import numpy as np
import pytest

from jcontour.app.files.results.verdict import exceeded, kept_words
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.runs.checks.machine_limits import (
    beyond_limits_asked,
    machine_limits,
    peak_controls,
)
from jcontour.motion.references import along, pad
from jcontour.simulation.evaluation import stack_references
from tests.app import small_runs
from tests.canonical import DT

SAMPLES = 20


def beyond(seen, machine):
    return exceeded(machine_limits(seen, scenarios(), machine))


def near(seen):
    return [one.line for one in machine_limits(seen, scenarios(), MACHINE) if one.near]


LIMITS = MachineLimits(speed=np.full(2, 0.2), control=np.full(2, 10.0))
MACHINE = small_runs.machine(LIMITS)
SCORED = np.arange(SAMPLES) >= 5  # the approach, or a rapid move, comes before


def scenarios(speed=0.0):
    """Two contours, along which X moves at a speed [m/s]."""
    position = np.zeros((2, SAMPLES, 2))
    position[..., 0] = DT * speed * np.arange(SAMPLES)
    jobs = small_runs.job("ring", SCORED), small_runs.job("eight", SCORED)
    return small_runs.scenarios(jobs, position, np.stack([SCORED, SCORED]))


def run():
    """Two contours on two plants, at rest."""
    return small_runs.replay(SAMPLES, (2, 2))


def test_limits_that_are_near_or_exceeded_are_named():
    seen = run()
    seen.control[1, 0, 7, 1] = -9.1
    seen.output[0, 1, 10:, 0] = 3e-4  # [m] in one sample
    assert beyond(seen, MACHINE) == [
        "speed of X EXCEEDS its limit: 18000 of 12000 mm/min (ring, late)"
    ]
    assert near(seen) == ["control of input 2 is near its limit: 9.1 of 10 A (eight, nominal)"]
    seen.control[1, 0, 7, 1] = -8.9
    seen.output[0, 1, 10:, 0] = 1.7e-4
    assert near(seen) == []
    assert beyond(seen, MACHINE) == []


def test_a_loop_overshoots_the_speed_of_a_motion_that_keeps_the_limit():
    """By a twentieth at most; beyond it, or where the motion itself is too fast, it exceeds it."""
    seen = run()
    seen.output[1, 0, :, 0] = 0.2009e-3 * np.arange(SAMPLES)
    at_limit = scenarios(speed=0.2)
    (line,) = (one.line for one in machine_limits(seen, at_limit, MACHINE) if one.near)
    assert "speed of X overshoots its limit" in line and "12054 of 12000 mm/min" in line
    assert exceeded(machine_limits(seen, at_limit, MACHINE)) == []
    assert len(exceeded(machine_limits(seen, scenarios(speed=0.201), MACHINE))) == 1
    seen.output[1, 0, :, 0] *= 1.06
    assert len(exceeded(machine_limits(seen, at_limit, MACHINE))) == 1


def test_a_loop_overshoots_the_acceleration_of_a_motion_that_keeps_the_limit():
    seen, machine = run(), small_runs.machine(MachineLimits(acceleration=np.full(2, 3.0)))
    seen.output[1, 1, :, 0] = 0.5 * 3.2 * (1e-3 * np.arange(SAMPLES)) ** 2
    assert beyond(seen, machine) == []
    seen.output[1, 1, :, 0] *= 3.4 / 3.2
    assert len(beyond(seen, machine)) == 1


def test_acceleration_between_samples_counts_beside_that_of_the_samples():
    seen, machine = run(), small_runs.machine(MachineLimits(acceleration=np.full(2, 3.0)))
    swing = 2.0 / machine.hidden_acceleration[0, 0]  # 2 m/s^2 between the samples
    seen.control[1, 1, 5:, 0] = swing * (-1.0) ** np.arange(SAMPLES - 5)
    assert beyond(seen, machine) == []  # 2 of 3 m/s^2
    seen.output[1, 1, :, 0] = 0.5 * 1.5 * (1e-3 * np.arange(SAMPLES)) ** 2
    assert beyond(seen, machine) == [
        "acceleration of X EXCEEDS its limit: 3.5 of 3 m/s^2, 2 of it between samples: the control "
        "alternates (eight, late)"
    ]


def test_a_run_that_diverged_has_no_peaks_and_hides_none():
    seen = run()
    seen.metrics.diverged[0, 1] = True
    seen.control[0, 1, 9:, 0] = np.nan
    seen.output[0, 1, 8, 0], seen.output[0, 1, 9:, 0] = 1e9, np.inf
    assert beyond(seen, MACHINE) == near(seen) == []
    seen.control[0, 0, 7, 0] = 20.0
    assert beyond(seen, MACHINE) == [
        "control of input 1 EXCEEDS its limit: 20 of 10 A (ring, nominal)"
    ]


def test_limits_hold_at_every_sample_scored_or_not():
    seen = run()
    seen.control[0, 1, 2, 0] = -50.0  # before the first scored sample
    seen.output[1, 0, 5:, 0] = 3e-4  # [m] between the last rapid and the first scored sample
    assert beyond(seen, MACHINE) == [
        "speed of X EXCEEDS its limit: 18000 of 12000 mm/min (eight, nominal)",
        "control of input 1 EXCEEDS its limit: 50 of 10 A (ring, late)",
    ]
    assert peak_controls(seen, scenarios()) == (50.0, 0.0)


def test_a_control_that_is_held_at_its_limit_saturates():
    """By the run that is there longest."""
    seen = run()
    seen.control[0, 0, 2, 0], seen.control[1, 1, 3:9, 0] = -10.0, 10.0
    assert near(seen) == [
        "control of input 1 SATURATES at 30 % of the samples: 10 of 10 A (eight, late)"
    ]
    assert "SATURATES" in kept_words(machine_limits(seen, scenarios(), MACHINE))


def test_the_stop_of_a_padded_run_in_motion_is_none_of_its_own():
    """Its loop is asked to stop at once, `preview` samples before the last arc length at first."""
    path, preview, steps = small_runs.LINE, 3, 12
    job = small_runs.job("ring", np.arange(steps) >= 5, at_rest=False)
    longer = pad(job.reference(DT, preview), SAMPLES)
    assert np.flatnonzero(longer.unpadded).tolist() == list(range(steps))
    at_rest = pad(along(path, job.arc, DT, preview, at_rest=True), SAMPLES)
    assert np.all(at_rest.unpadded)
    family = small_runs.scenarios([job], np.zeros((1, SAMPLES, 2)), np.ones((1, SAMPLES), bool))
    padded = family._replace(references=stack_references([longer]))
    seen = small_runs.replay(SAMPLES, (1, 2))
    seen.control[0, 0, steps, 0] = 20.0
    assert exceeded(machine_limits(seen, padded, MACHINE)) == []
    seen.control[0, 0, steps - 1, 0] = 20.0
    assert len(exceeded(machine_limits(seen, padded, MACHINE))) == 1


def motion(steps, acceleration, dt=1e-3):
    """One axis speeds up and brakes again, the other one rests."""
    push = np.repeat([acceleration, -acceleration], steps)
    speed = np.concatenate([[0.0], np.cumsum(push) * dt])
    place = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * dt])
    return np.stack([place, 0.0 * place], axis=1)


def limited(speed=None, acceleration=None):
    each = (None if one is None else np.full(2, one) for one in (speed, acceleration))
    return small_runs.machine(MachineLimits(*each))


@pytest.mark.parametrize(
    ("limits", "lines"),
    [
        ({"acceleration": 1.9}, ["acceleration of X"]),
        ({"acceleration": 2.1}, []),
        ({"speed": 0.09}, ["speed of X"]),
        ({"speed": 0.11}, []),
        ({}, []),
    ],
)
def test_what_a_reference_asks_for_is_held_against_the_limits(limits, lines):
    calm, quick = motion(50, 1.0), motion(50, 2.0)
    exceeded = beyond_limits_asked(quick, calm, limited(**limits), at_rest=True)
    assert [one.name.partition(" that the reference")[0] for one in exceeded] == lines


def test_a_step_at_the_begin_counts_where_a_motion_begins_at_rest():
    """1 um in a sample of 1 ms: 1 m/s^2 from rest, and nothing of a motion that is under way."""
    calm = motion(50, 0.1)
    moved = calm + np.array([0.0, 1e-6])
    machine = limited(acceleration=0.5)
    assert beyond_limits_asked(moved, calm, machine, at_rest=True) == []  # it rests beside
    moved[0] = calm[0]
    (one,) = beyond_limits_asked(moved, calm, machine, at_rest=True)
    assert "acceleration of Y" in one.name and one.value == pytest.approx(1) and not one.kept


def test_what_was_asked_for_before_is_not_told_again():
    quick = motion(50, 2.0)
    assert beyond_limits_asked(quick, quick, limited(acceleration=1.0), at_rest=True) == []
