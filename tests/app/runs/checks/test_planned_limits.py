"""Limits that a motion itself exceeds, against closed forms of its corners."""

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
from jcontour.app.runs.checks.planned_limits import limits_exceeded_by_plan
from jcontour.geometry.contours import line
from jcontour.motion.point_to_point import ToAndFro
from tests.app import small_runs
from tests.canonical import DT

EXAMPLE = Path(jobs.__file__).parents[1] / "machines" / "example.json"


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
    (told,) = limits_exceeded_by_plan(
        scenarios([move], [points]), machine_of(acceleration=[0.19, 1.0])
    )
    assert "X 0.2 of 0.19 m/s^2" in told and told.endswith("not the loop")
    assert limits_exceeded_by_plan(scenarios([move], [points]), machine_of(None, [0.21, 1])) == []


def seen_by(found, machine):
    return Scenarios.of([found], [False], machine, "outputs", 1)


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
    told = re.findall(r"([XY]) ([\d.]+) of ([\d.]+)", line)
    assert told
    for axis, value, limit in told:
        most = allowed["XY".index(axis)]
        assert float(limit) == pytest.approx(most, rel=1e-3)
        assert max(most, v / dt / 2) < float(value) <= v / dt + 0.5 * most
    assert re.search("line [23] of the file", line) and "--feed-law jerk" in line


@pytest.mark.parametrize("acceleration", [None, 100.0])
@pytest.mark.parametrize("name", ["square", "bracket"])
def test_the_jerk_limited_law_keeps_every_limit(machine, name, acceleration):
    """Half of what the machine states, or all of it."""
    found = job_named(name, Pace(machine, None, acceleration))
    assert limits_exceeded_by_plan(seen_by(found, machine), machine) == []
