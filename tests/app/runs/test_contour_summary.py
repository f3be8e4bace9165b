"""The lengths and the time of a run that are stated for its program."""

import math

import numpy as np
import pytest

from jcontour.app.catalogue.entries import MACHINES
from jcontour.app.jobs.contours import BUILT_IN
from jcontour.app.jobs.job import Job, Pace, at_constant_feed, from_file
from jcontour.app.jobs.stretches import shortened
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.reports.run_tables import motion_table
from jcontour.app.reports.tables import read_line
from jcontour.app.runs.contour_summary import (
    contour_runs,
    cycle_time,
    motion_summary,
    peak_place,
    read_of,
)
from jcontour.geometry.contours import circle, line
from tests.app import small_runs
from tests.canonical import DT

STEPS = 50
PLANTS = ("nominal", "late", "heavy")
MACHINE = small_runs.machine()


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 F600\nG1 X20\nG0 X50 Y40\nG3 X50 Y60 J10\n")
    return path


def read(program, law):
    machine = MACHINES["bridgeport"]()
    job = from_file(program, Pace(machine, None, None, law))
    return job, read_of(job, machine.model.dt)


def test_the_length_of_the_rapid_moves_is_that_of_their_lines(program):
    _, summary = read(program, "jerk")
    assert summary.rapid_length == pytest.approx(50e-3)
    assert summary.length - summary.rapid_length == pytest.approx(1e-3 * (20 + 10 * math.pi))


def test_the_box_is_that_of_the_program_and_not_of_the_smoothed_path(tmp_path):
    """A circle in chords, whose smoothed path lies beside its corners."""
    angle = np.linspace(0, 2 * np.pi, 73)
    x, y = np.round([4 * np.cos(angle), 4 * np.sin(angle)], 3)
    path = tmp_path / "chords.ngc"
    moves = [f"G1 X{a} Y{b}\n" for a, b in zip(x, y, strict=True)]
    path.write_text("".join(["G21 F600\nG0 X4\n", *moves]))
    pace = Pace(MACHINES["bridgeport"](), None, None, "jerk", corner_tolerance=20e-6)
    job = from_file(path, pace)
    assert job.reference(5e-4, 1).position.min() != pytest.approx(-4e-3, abs=1e-8)
    summary = read_of(job, 5e-4)
    assert summary.low == pytest.approx((-4e-3, -4e-3), abs=1e-12)
    assert summary.high == pytest.approx((4e-3, 4e-3), abs=1e-12)


def test_the_time_of_a_run_is_the_cycle_time_of_its_motion(program):
    job, summary = read(program, "jerk")
    cells = motion_table(motion_summary(job.planned), "XY").columns[1].cells
    assert f"in {next(iter(cells))}," in read_line("part", summary, "XY")


def test_the_time_of_a_run_is_that_from_its_first_sample_to_its_last(program):
    """By the trapezoidal law, 20 mm at 10 mm/s and 2 m/s^2: both ramps cost v / a, in samples."""
    program.write_text("G21 F600\nG1 X20\n")
    _, summary = read(program, "trapezoidal")
    dt = MACHINES["bridgeport"]().model.dt
    assert summary.duration == pytest.approx(dt * math.ceil((2.0 + 0.005) / dt))
    assert summary.rapid_length == 0.0


PACE = Pace(MACHINES["bridgeport"](), None, None)  # 3000 mm/min, 25 um in a sample of 0.5 ms


def line_of(job: Job) -> str:
    return read_line(job.name, read_of(job, 5e-4), "XY")


def test_a_run_that_ends_early_tells_how_far_it_goes():
    """249 steps are 6.225 mm, the entry of 100 is 2.5 mm; 219 steps of the small one 5.475 mm."""
    eight = shortened(BUILT_IN["lemniscate"](PACE), 150)
    length = 1e3 * float(eight.contour.length)
    assert f", the first 6.225 of {length:.5g} mm in 0.124 s, X" in line_of(eight)
    assert line_of(eight).endswith("; scored behind the first 2.5 mm")
    small = shortened(at_constant_feed("small", circle(0.6e-3), PACE), 120)
    lap = 1.2 * math.pi
    assert f", {lap:.5g} mm in {lap / 50:.3f} s, X" in line_of(small)
    assert line_of(small).endswith(f"; {5.475 / lap:.3g} laps, scored behind the first 2.5 mm")


def test_an_open_contour_at_constant_feed_is_run_once():
    way = at_constant_feed("way", line([0.0, 0.0], [8e-3, 0.0]), PACE)
    assert line_of(way) == "way: 1 move, 8 mm in 0.160 s, X 0 ... 8, Y 0 ... 0 mm; " + (
        "scored behind the first 2.5 mm"
    )


def test_a_run_from_rest_to_rest_tells_nothing_of_laps(program):
    job, summary = read(program, "jerk")
    assert summary.way is None and summary.entry == 0.0 and ";" not in line_of(job)


def test_rapid_moves_and_plunges_are_in_the_cycle_time_at_every_feed(tmp_path):
    """At most 0.2 m/s, 2 m/s^2, which builds up in 20 ms: L / v + v / a + 20 ms, or without v."""
    path = tmp_path / "part.ngc"
    path.write_text("G21 G90\nG1 X10 F3000\nG0 Z5\nG0 Y20\nG1 Z0 F600\nG1 X0 F3000\n")
    limits = MachineLimits(speed=np.full(2, 0.2), acceleration=np.full(2, 4.0))
    machine = small_runs.machine(limits)
    speed = (math.sqrt(0.04**2 + 4 * 0.04) - 0.04) / 2  # of the rapid move of 20 mm
    rapid = 0.02 / speed + speed / 2 + 0.02
    slow = 0.01 / 0.025 + 2 * math.sqrt(0.025 / 100)  # never at 2 m/s^2
    usual = 0.01 / 0.05 + 0.05 / 2 + 0.02
    for override, wanted in ((0.5, 2 * slow + rapid + 1.0), (1.0, 2 * usual + rapid + 0.5)):
        job = from_file(path, Pace(machine, None, None, override=override))
        assert cycle_time(job, DT) == pytest.approx(wanted, abs=6e-3)


def made(diverged=(False, False, False)):
    """Errors off a line along X: little, even, and with one peak."""
    error = np.zeros((1, 3, STEPS, 2))
    error[0, 0, :, 1], error[0, 1, :, 1], error[0, 2, 30, 1] = 1e-7, 2e-6, 5e-6
    path = np.stack([np.linspace(0.0, 1e-2, STEPS), np.zeros(STEPS)], axis=1)[None]
    size = np.abs(error[..., 1])
    numbers = {
        "rms_contour_error": np.sqrt(np.mean(size**2, axis=-1)),
        "peak_contour_error": size.max(axis=-1),
        "diverged": np.array([diverged]),
    }
    replay = small_runs.replay(STEPS, (1, 3), **numbers)
    replay = replay._replace(output=path[:, None] + error, contour_error=error)
    counted = np.ones(STEPS, bool)
    job = small_runs.job("line", counted)
    return replay, small_runs.scenarios([job], path, counted[None], plants=PLANTS)


def drawn(labels, **changes):
    replay, scenarios = made(**changes)
    runs = contour_runs({label: replay for label in labels}, scenarios, 0, MACHINE)
    return [[run.plant for run in row] for row in runs.rows]


def test_a_run_alone_is_drawn_on_the_plant_whose_largest_error_is_printed():
    replay, scenarios = made()
    assert peak_place(scenarios, replay, 0, "contour").plant == "heavy"
    assert drawn(["mine"]) == [["nominal plant"], ["largest error (heavy)"]]


def test_runs_to_compare_are_drawn_on_the_plants_of_their_largest_rms():
    _, worst = drawn(["start", "tuned"])
    assert worst == ["largest RMS (late)", "largest RMS (late)"]


def test_a_plant_that_diverges_is_the_worst():
    assert drawn(["mine"], diverged=(False, True, False))[1] == ["largest error (late)"]
