"""The lengths and the time of a run that are told of its program."""

import math

import numpy as np
import pytest

from experiments.catalogue.machines import MACHINES
from experiments.jobs.job import Pace, from_file
from experiments.reports.simulated_tables import motion_table
from experiments.reports.tables import read_line
from experiments.runs.contour_summary import read_of
from experiments.runs.motion_summary import motion_summary


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 F600\nG1 X20\nG0 X50 Y40\nG3 X50 Y60 J10\n")
    return path


def read(program, law):
    machine = MACHINES["bridgeport"]()
    job = from_file(program, Pace(machine, None, None, law))
    return job, read_of(job, np.zeros((job.samples, 2)), machine.model.dt)


def test_the_length_of_the_rapid_moves_is_that_of_their_lines(program):
    _, found = read(program, "jerk")
    assert found.rapid_length == pytest.approx(50e-3)
    assert found.length - found.rapid_length == pytest.approx(1e-3 * (20 + 10 * math.pi))


def test_the_time_of_a_run_is_the_cycle_time_of_its_motion(program):
    job, found = read(program, "jerk")
    cells = motion_table(motion_summary(job.planned), "XY").columns[1].cells
    assert f"in {next(iter(cells))}," in read_line("part", found, "XY")


def test_the_time_of_a_run_is_that_from_its_first_sample_to_its_last(program):
    """By the trapezoidal law, 20 mm at 10 mm/s and 2 m/s^2: both ramps cost v / a, in samples."""
    program.write_text("G21 F600\nG1 X20\n")
    _, found = read(program, "trapezoidal")
    dt = MACHINES["bridgeport"]().model.dt
    assert found.duration == pytest.approx(dt * math.ceil((2.0 + 0.005) / dt))
    assert found.rapid_length == 0.0
