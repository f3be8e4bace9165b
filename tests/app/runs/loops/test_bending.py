"""Moves of a bent reference with rapid moves: read back as they are meant."""

import jax
import numpy as np
import pytest

from jcontour.app.files.bent_reference import PROGRAM, save_program
from jcontour.app.jobs.job import AxisMove, Job
from jcontour.app.jobs.motion_laws import Aside
from jcontour.app.jobs.sections import Section
from jcontour.app.runs.loops.bending import MOST, STILL, moves_along, settling, with_held_end
from jcontour.geometry.contours import line
from jcontour.geometry.toolpaths import read_gcode
from jcontour.linear.plant import LinearPlant
from jcontour.plants.encoders import Encoders
from jcontour.simulation.evaluation import stack_plants
from tests.small_loops import Proportional

DT = 1e-3


def square_with_a_way_between():
    """A cut along X, a rapid move up along Y and on along X, a cut back; 10 um a sample."""
    way = [(k, 0) for k in range(300)] + [(300, k) for k in range(300)]
    way += [(300 + k, 300) for k in range(100)] + [(400 - k, 300) for k in range(301)]
    asked = ((7, "Z moves"), (8, "rapid move begins"))
    run = [
        Section(0, 300, asked=((3, "start"),)),
        Section(300, 700, rapid=True, corners=(600,), asked=asked),
        Section(700, 1000, asked=((12, "cut goes on"),)),
    ]
    return 1e-5 * np.array(way, float), run


def test_what_is_not_cut_is_read_back_as_rapid_and_the_program_stops_around_it(tmp_path):
    position, run = square_with_a_way_between()
    save_program(moves_along(position, DT, run, "part.ngc"), "XY", tmp_path)
    read = read_gcode(tmp_path / PROGRAM, "XY")
    ends = np.asarray(read.contour.position(np.asarray(read.contour.start)))
    rapid = np.flatnonzero(read.rapid)
    np.testing.assert_allclose(1e3 * ends[rapid], [[3, 0], [3, 3]], atol=1e-9)
    np.testing.assert_allclose(1e3 * ends[rapid[-1] + 1], [4, 3], atol=1e-9)
    between = [stop.after for stop in read.asks if stop.after]
    assert between == [rapid[0], rapid[-1] + 1] and {stop.why for stop in read.asks[1:]} == {"M0"}
    text = (tmp_path / PROGRAM).read_text()
    assert "M0 (part.ngc, line 7: Z moves, line 8: rapid move begins)\nG0 X3.00000 Y3.00" in text
    assert text.startswith(
        "G21 G90 G64 P0.001\nG0 X0.00000 Y0.00000\nM0 (part.ngc, line 3: start)\n"
    )
    assert text.count("M0 ") == 3
    assert read.stops.startswith("2 stops: M0 2 times")  # the first one is before the first cut


DT, STEPS = 2e-3, 50


def run(aside=None):
    """A line at constant speed that ends at once; the first half is not scored."""
    arc = 1e-4 * np.arange(STEPS)
    path = line([0.0, 0.0], [arc[-1], 0.0])
    return Job("line", path, arc, np.arange(STEPS) >= 25, True, "constant", aside=aside)


def drives(*gains):
    """Plants y+ = y + gain u on both axes."""
    plants = [LinearPlant(np.eye(2), gain * np.eye(2), np.eye(2), DT) for gain in gains]
    return stack_plants([Encoders(plant) for plant in plants])


def samples_to_rest(gain):
    """Of y+ = y + gain (p - y): from the last sample of p until y is within `STILL` of it."""
    y, p = 0.0, 1e-4 * np.arange(STEPS)
    for target in p[:-1]:
        y += gain * (target - y)
    count = 0
    while p[-1] - y > STILL:
        y += gain * (p[-1] - y)
        count += 1
    return count


def test_a_run_is_held_until_the_slowest_tool_rests():
    quick, slow = samples_to_rest(0.2), samples_to_rest(0.1)
    assert 20 < quick < slow < 100
    assert settling(run(), drives(0.2), Proportional(1.0), DT) == quick
    assert settling(run(), drives(0.2, 0.1), Proportional(1.0), DT) == slow


@pytest.mark.slow
def test_a_trial_becomes_longer_until_the_end_of_it_is_at_rest():
    """At 1/80 a sample it takes 1.7 s, at 1/200 longer than is tried; a pole of -1.1 is lost."""
    assert settling(run(), drives(0.0125), Proportional(1.0), DT) == samples_to_rest(0.0125)
    assert DT * samples_to_rest(0.0125) > 1.0
    assert DT * samples_to_rest(0.005) > MOST
    assert settling(run(), drives(0.005), Proportional(1.0), DT) is None
    assert settling(run(), drives(2.1), Proportional(1.0), DT) is None


def test_the_last_sample_is_held_and_scored_as_it_is():
    before = run()
    after = with_held_end(before, 7)
    reference, usual = (jax.device_get(one.reference(DT, 3)) for one in (after, before))
    assert after.steps == STEPS + 7 and reference.steps == STEPS + 7
    assert np.array_equal(reference.position[:STEPS], usual.position[:STEPS])
    assert np.all(reference.position[STEPS:] == usual.position[STEPS - 1])
    assert np.array_equal(np.flatnonzero(reference.mask), np.arange(25, STEPS + 7))


def test_beside_its_contour_the_last_offset_is_held():
    offset = np.linspace(0.0, 1e-5, STEPS)[:, None] * [0.0, 1.0]
    aside = Aside(offset, np.tile([1.0, 0.0], (STEPS, 1)))
    reference = with_held_end(run(aside), 4).reference(DT, 2)
    assert np.asarray(reference.position)[STEPS:, 1] == pytest.approx(1e-5)


def test_a_move_of_one_axis_lasts_longer():
    def law(time):
        return np.minimum(time, 0.1)

    move = AxisMove("move", line([0.0], [0.1]), law, 0.1, 0.0, DT, "straight")
    held = with_held_end(move, 5)
    assert held.samples == move.samples + 5
    assert np.asarray(held.reference(DT, 1).position)[-6:] == pytest.approx(0.1)
