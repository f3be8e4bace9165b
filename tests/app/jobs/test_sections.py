"""Sections of a run: where they begin, and what is to be done there."""

import numpy as np
import pytest

from jcontour.app.catalogue.choices import job_named
from jcontour.app.catalogue.entries import MACHINES
from jcontour.app.jobs.job import Pace, from_file
from jcontour.app.jobs.sections import PREPARED, Section, halted, sections

PART = """G21 G90
M3 S1000
G0 X1 Y0
G1 Z-1 F300
G1 X5 F600
G0 Z5
G0 X5 Y3
X8
G1 Z-1
G1 X12
M5
G1 Y6
"""


@pytest.fixture(scope="module")
def machine():
    return MACHINES["bridgeport"]()


def run_of(text, machine, folder, name="part.ngc"):
    (folder / name).write_text(text)
    return from_file(folder / name, Pace(machine, None, None))


def places(job, machine, samples):
    """Positions at samples [mm]."""
    return 1e3 * np.asarray(job.reference(machine.model.dt, 0).position)[samples]


def test_a_run_stops_where_the_tool_is_lifted_lowered_or_switched(machine, tmp_path):
    job = run_of(PART, machine, tmp_path)
    parts = sections(job)
    assert [one.rapid for one in parts] == [False, True, False, False]
    assert [one.asked for one in parts] == [
        ((5, PREPARED),),
        ((6, "Z moves"), (7, "rapid move begins")),
        ((9, "Z moves"), (10, "cut goes on")),
        ((11, "M5"),),
    ]
    ends = places(job, machine, [one.first for one in parts] + [parts[-1].last])
    np.testing.assert_allclose(ends, [[1, 0], [5, 0], [8, 3], [12, 3], [12, 6]], atol=2e-3)
    (corner,) = parts[1].corners
    np.testing.assert_allclose(places(job, machine, [corner]), [[5, 3]], atol=2e-2)
    assert [one.last for one in parts[:-1]] == [one.first for one in parts[1:]]


def test_the_tool_is_down_where_it_rests_before_a_cut(machine, tmp_path):
    """Z takes 1 mm at 300 mm/min, 0.2 s: the cut begins with that rest."""
    job = run_of(PART, machine, tmp_path)
    _, rapid, cut, _ = sections(job)
    rest = round(0.2 / machine.model.dt)
    assert np.ptp(job.arc[cut.first : cut.first + rest]) < 1e-9 < np.ptp(job.arc[rapid.last - 9 :])


def test_the_reference_is_held_in_rapid_moves_and_where_it_stops(machine, tmp_path):
    job = run_of(PART, machine, tmp_path)
    x, y = places(job, machine, slice(None, job.steps)).T
    held = halted(job)
    rapid = ((x > 5.01) | (y > 0.01)) & (x < 7.99)
    assert held[rapid].all() and held[0]
    assert not held[(x > 1.01) & (x < 4.99) & (y == 0)].any()
    assert not held[(x > 8.01) & (x < 11.99)].any()
    (switched,) = np.flatnonzero(held & (x > 8.01))  # M5
    np.testing.assert_allclose([x[switched], y[switched]], [12, 3], atol=2e-3)


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("G21 G1 X10 F600\n", ()),
        ("G21 G1 X10 F600\nG1 Y10\nG4 P1\nX0\n", ()),  # a dwell is kept
        ("G21 G0 X2\nG1 X10 F600\n", ((2, PREPARED),)),
        ("G21 M3 S800\nG1 X10 F600\n", ((2, PREPARED),)),
        ("G21 G1 Z-1 F300\nG1 X10 F600\n", ((2, PREPARED),)),
        ("G21 G1 X10 Z-1 F600\n", ((1, PREPARED),)),
    ],
)
def test_it_is_prepared_where_more_than_its_axes_is_asked_for(text, asked, machine, tmp_path):
    job = run_of(text, machine, tmp_path)
    assert sections(job) == [Section(0, job.steps - 1, asked=asked)]


def test_points_and_built_in_contours_are_one_section(machine, tmp_path):
    points = run_of("0,0\n5,0\n5,5\n", machine, tmp_path, "points.csv")
    circle = job_named("circle", Pace(machine, None, None))
    for job in (points, circle):
        assert sections(job) == [Section(0, job.steps - 1)]
