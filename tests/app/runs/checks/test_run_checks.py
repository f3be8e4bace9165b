"""Checks of runs beside their limits, each on runs made by hand."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.jobs import job as jobs
from jcontour.app.jobs.job import AxisMove, from_file
from jcontour.app.jobs.pace import Pace
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.runs.checks.run_checks import (
    arrival_warnings,
    limits_exceeded_by_plan,
    lost_numbers,
    motions_not_followed,
    swing_warnings,
)
from jcontour.geometry.contours import line
from jcontour.motion.point_to_point import ToAndFro
from tests.app import small_runs
from tests.canonical import DT

SAMPLES, PEAK = 101, 2e-6
TO_REST = 1e-3 * (1 - np.cos(np.pi * np.arange(SAMPLES) / (SAMPLES - 1))) / 2
IN_MOTION = 1e-5 * np.arange(SAMPLES)
SWINGING, ERROR = 12, 1e-6
MACHINE = small_runs.machine(encoder_resolution=0.2 * ERROR)
HIDDEN = MACHINE.hidden_acceleration[1, 1]
LASTING = 20
COUNTED = np.ones(LASTING, bool)
RING = small_runs.job("ring", COUNTED)
SCENARIOS = small_runs.scenarios([RING], np.zeros((1, LASTING, 2)), COUNTED[None])
EXAMPLE = Path(jobs.__file__).parents[1] / "machines" / "example.json"


def arrival_lines(apart, path=TO_REST, lost=False, scored=True):
    """One contour on two plants; the second one ends so far from the end [m]."""
    position = np.stack([path, np.zeros(SAMPLES)], axis=1)[None]
    output = np.repeat(position[:, None], 2, axis=1)
    output[0, 1, -1, 1] += apart
    numbers = {"diverged": np.array([[False, lost]])}
    numbers["peak_contour_error"] = np.array([[0.5 * PEAK, PEAK]])
    mask = np.full((1, SAMPLES), scored)
    scenarios = small_runs.scenarios([small_runs.job("part", mask[0])], position, mask)
    replay = small_runs.replay(SAMPLES, **numbers)._replace(output=output)
    return arrival_warnings(replay, scenarios)


def test_a_tool_that_has_not_arrived_is_told():
    [line] = arrival_lines(2.1 * PEAK)
    assert "the tool is still 4.2 um from its end (part, late)" in line


@pytest.mark.parametrize(
    "given",
    [
        {"apart": 1.9 * PEAK},  # as much as the errors on the way
        {"apart": 9 * PEAK, "path": IN_MOTION},  # it goes on
        {"apart": 9 * PEAK, "lost": True},  # reported as diverged
        {"apart": 9 * PEAK, "scored": False},  # a rapid move
    ],
)
def test_otherwise_nothing_is_told(given):
    assert arrival_lines(**given) == []


@pytest.mark.parametrize(("moved", "lines"), [(0.0, 1), (0.49, 1), (0.51, 0), (1.0, 0)])
def test_a_tool_that_moves_less_than_half_of_the_way_does_not_follow(moved, lines):
    """To and fro: the tool ends where it should, also one that rests on the path all the time."""
    path = np.concatenate([TO_REST, TO_REST[::-1]])
    position = np.stack([path, np.zeros(len(path))], axis=1)[None]
    output = np.stack([position, moved * position], axis=1)
    output[0, 0, -1] = np.nan  # lost: reported as diverged
    mask = np.ones((1, len(path)), bool)
    job, plants = small_runs.job("part", mask[0]), ("lost", "late")
    scenarios = small_runs.scenarios([job], position, mask, plants=plants)
    messages = motions_not_followed(small_runs.replay(len(path))._replace(output=output), scenarios)
    assert len(messages) == lines
    assert all(f"moves {2 * moved:.4g} of 2 mm (part, late)" in line for line in messages)


def seen(amplitude, lost=False):
    """One contour on two plants; the control of the second one alternates."""
    numbers = {"diverged": np.array([[False, lost]]), "rms_contour_error": np.array([[0.0, ERROR]])}
    replay = small_runs.replay(SWINGING, **numbers)
    replay.control[0, 1, :, 1] = amplitude * (-1.0) ** np.arange(SWINGING)
    return replay


EVERY = np.ones(SWINGING, bool)


def warnings(replay, counted=EVERY, machine=MACHINE):
    position = np.zeros((1, SWINGING, 2))
    scenarios = small_runs.scenarios([small_runs.job("ring", counted)], position, counted[None])
    return swing_warnings(replay, scenarios, machine)


def test_a_swing_of_much_of_the_error_is_told():
    """RMS of the fine samples of a parabola, a quarter of the error."""
    arc = 4 * (t := np.linspace(0, 1, 10_001)) * (1 - t)
    height = 0.25 * ERROR / np.sqrt(np.mean(arc**2))
    [line] = warnings(seen(height / (HIDDEN * DT**2 / 8)))
    assert line.startswith(
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
    assert warnings(replay, SCORED := np.arange(SWINGING) >= 4)
    replay.control[0, 1, SCORED] = 0.0
    assert warnings(replay, np.arange(SWINGING) >= 5) == []


def test_a_run_that_diverged_has_none():
    replay = seen(1e3, lost=True)
    replay.control[0, 1, 5] = np.nan
    assert warnings(replay) == []


def run(**lost):
    """One contour on two plants, at rest but for what is given: (plant, sample, axis, value)."""
    replay = small_runs.replay(LASTING)
    for name, (plant, sample, axis, value) in lost.items():
        getattr(replay, name)[0, plant, sample:, axis] = value
    return replay


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
            {"output": (0, LASTING - 1, 1, np.nan)},
            f"the output is NaN (not a number) from sample {LASTING - 1} ",
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


def machine_of(speed=None, acceleration=None):
    limits = (None if one is None else np.array(one) for one in (speed, acceleration))
    return small_runs.machine(MachineLimits(*limits))


def scenarios(jobs, points):
    """Runs padded to one length by samples that no motion has."""
    steps = max(map(len, points))
    padded = [np.vstack([rows, np.full((steps + 3 - len(rows), 2), 9.0)]) for rows in points]
    counted = np.ones((len(jobs), steps + 3), bool)
    return small_runs.scenarios(jobs, np.stack(padded), counted, steps, plants=("nominal",))


def job(name, points, at_rest=False):
    return small_runs.job(name, np.ones(len(points), bool), at_rest)


def around_a_corner(v, before=40, after=30):
    """v along X, then along Y: the velocity of each axis jumps by v within the sample `before`."""
    x = np.concatenate([np.arange(before + 1), np.full(after, before)])
    y = np.concatenate([np.zeros(before + 1), np.arange(1, after + 1)])
    return v * DT * np.stack([x, y], axis=1)


def test_a_jump_of_the_velocity_is_told_with_every_axis_and_its_place():
    """It asks for v / dt; the second of two motions, shorter than the first, has the larger one."""
    slow, quick = around_a_corner(1e-3, 60, 60), around_a_corner(2e-3)
    seen = scenarios([job("ring", slow), job("eight", quick)], [slow, quick])
    (line,) = limits_exceeded_by_plan(seen, machine_of(acceleration=[1.5, 1.0]))
    assert line.startswith(
        "acceleration that the motion itself asks for EXCEEDS the limit: X 2 of 1.5, Y 2 of 1 m/s^2"
        " (eight, Y at t 0.04 s): the plan does so, not the loop"
    )
    (line,) = limits_exceeded_by_plan(seen, machine_of(acceleration=[2.5, 1.9]))
    assert "the limit: Y 2 of 1.9 m/s^2 (" in line
    assert limits_exceeded_by_plan(seen, machine_of(acceleration=[2.1, 2.1])) == []
    assert limits_exceeded_by_plan(seen, machine_of()) == []


def test_a_speed_beyond_the_limit_asks_for_a_lower_feed():
    """At a constant feed, whose first sample is not at rest."""
    points = around_a_corner(2e-3)
    seen = scenarios([job("ring", points)], [points])
    (line,) = limits_exceeded_by_plan(seen, machine_of(speed=[3e-3, 1e-3]))
    assert "speed that" in line and "Y 0.002 of 0.001 m/s (ring, Y at t 0.041 s)" in line
    assert line.endswith("; a lower --feed-mm-per-min keeps it")
    assert limits_exceeded_by_plan(seen, machine_of(speed=[2e-3, 2e-3])) == []


def test_the_first_step_from_rest_and_the_last_one_to_rest_count():
    points = np.stack([1e-6 * np.arange(20), np.zeros(20)], axis=1)  # 1 mm/s
    under_way, stands = job("line", points), job("line", points, at_rest=True)
    machine = machine_of(acceleration=[0.9, 0.9])
    assert limits_exceeded_by_plan(scenarios([under_way], [points]), machine) == []
    (line,) = limits_exceeded_by_plan(scenarios([stands], [points]), machine)
    assert "X 1 of 0.9 m/s^2 (line, X at t 0 s)" in line


def test_a_move_of_an_axis_begins_as_its_law_has_it():
    """0.05 cos(2 t): up to 0.2 m/s^2, and no rest at the end, which would be a jump."""
    rows = 0.05 * np.cos(2.0 * DT * np.arange(1001))
    points = np.stack([rows, 0.0 * rows], axis=1)
    move = AxisMove("task-b", line([0.0], [0.1]), ToAndFro(0.1, 2.0), 1.0, 0.0, DT, "cosine")
    (message,) = limits_exceeded_by_plan(
        scenarios([move], [points]), machine_of(acceleration=[0.19, 1.0])
    )
    assert "X 0.2 of 0.19 m/s^2" in message and message.endswith("not the loop")
    assert limits_exceeded_by_plan(scenarios([move], [points]), machine_of(None, [0.21, 1])) == []


def seen_by(job, machine):
    return Scenarios.of([job], [False], machine, "outputs", 1)


PROGRAM = "G21 G90 F3000\nG1 X20\nG1 Y20\n"


@pytest.fixture(scope="module")
def machine():
    return machine_named(str(EXAMPLE))


def test_the_trapezoidal_law_in_a_corner(tmp_path, machine):
    """A square corner is passed at v^2 = A d s / (1 - s), s = sin 45 deg, d = 5 um.

    The velocity of an axis changes by v within one or two samples, beside half the acceleration
    that the machine states.
    """
    part = tmp_path / "part.ngc"
    part.write_text(PROGRAM)
    pace = Pace(machine, None, None, "trapezoidal")
    allowed = machine.limits.acceleration
    dt, s = machine.model.dt, math.sin(math.pi / 4)
    along = min(0.5 * allowed.min(), (0.5 * allowed / s).min())  # across the bisector too
    v = math.sqrt(along * 5e-6 * s / (1 - s))
    (line,) = limits_exceeded_by_plan(seen_by(from_file(part, pace), machine), machine)
    axes = re.findall(r"([XY]) ([\d.]+) of ([\d.]+)", line)
    assert axes
    for axis, value, limit in axes:
        most = allowed["XY".index(axis)]
        assert float(limit) == pytest.approx(most, rel=1e-3)
        assert max(most, v / dt / 2) < float(value) <= v / dt + 0.5 * most
    assert re.search("line [23] of the file", line) and "--feed-law jerk" in line


@pytest.mark.parametrize("acceleration", [None, 100.0])
@pytest.mark.parametrize("name", ["square", "bracket"])
def test_the_jerk_limited_law_keeps_every_limit(machine, name, acceleration):
    """Half of what the machine states, or all of it."""
    job = job_named(name, Pace(machine, None, acceleration))
    assert limits_exceeded_by_plan(seen_by(job, machine), machine) == []
