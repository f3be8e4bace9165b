"""The clock of written moves keeps to the times that were asked for."""

import numpy as np
import pytest

from jcontour.app.files.bent_reference import (
    CHORD,
    LEAST_FEED,
    PROGRAM,
    SAMPLES,
    clock,
    moves_through,
    save_program,
    save_samples,
    steps,
)
from jcontour.geometry.toolpaths import read_gcode

DT = 1e-3


def test_rounded_feeds_do_not_drift():
    """Ten thousand moves of an odd length: alone, each feed of six digits is off by up to 5e-6."""
    places = np.cumsum(np.full((10_001, 1), 1.0 / 3.0), axis=0)
    lasting = np.full(10_000, 0.0137)
    written = steps(places, lasting)
    times, at = clock(places, written)
    np.testing.assert_allclose(times[1:], np.cumsum(lasting), atol=2e-7)
    np.testing.assert_array_equal(at, places)
    assert {len(f"{step.word:.15g}".replace(".", "")) for step in written} <= {5, 6}


def test_a_move_too_slow_for_a_program_waits_behind_its_end():
    """1 nm in a second is 60 nm/min; the program may say 60 um/min at least."""
    places = np.array([[0.0], [1e-6], [1.0]])
    (first, dwell, last) = steps(places, np.array([1.0, 0.1]))
    assert first.word == LEAST_FEED and dwell.end is None
    np.testing.assert_allclose(60 * 1e-6 / first.word + dwell.word, 1.0, rtol=1e-6)
    np.testing.assert_allclose(last.word, 600.0, rtol=1e-5)


def test_rests_in_a_row_are_one_dwell():
    places = np.array([[1.0], [1.0], [1.0], [2.0], [2.0]])
    written = steps(places, np.array([0.2, 0.3, 0.1, 1234.5678912]))
    assert [step.end for step in written] == [None, 3, None]
    times, at = clock(places, written)
    np.testing.assert_allclose(times, [0, 0.5, 0.6, 1235.1678912], atol=1e-5)
    np.testing.assert_array_equal(at, [[1], [1], [2], [2]])


def spiral(steps=2000):
    angle = 2e-3 * np.arange(steps)
    return 1e-2 * (1 + 0.1 * angle[:, None]) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_moves_stay_near_every_sample_and_are_few():
    position = spiral()
    moves = moves_through(position, DT)
    assert 0 < moves.chord <= CHORD and len(moves.lasting) < len(position) / 7
    np.testing.assert_allclose(moves.ends[[0, -1]], position[[0, -1]], atol=5e-9)
    assert np.sum(moves.lasting) == pytest.approx(DT * (len(position) - 1))


def test_a_program_at_its_feeds_is_where_the_samples_are_and_asks_for_no_jump(tmp_path):
    """60 mm/s and back to rest at 3 m/s^2, read back and played by the clock."""
    time, most, speed = DT * np.arange(141), 3.0, 0.06
    reached = speed / most
    up = 0.5 * most * np.minimum(time, reached) ** 2 + speed * np.maximum(time - reached, 0)
    way = np.where(time < 0.07, up, 2 * np.interp(0.07, time, up) - up[::-1])
    position = way[:, None] * [0.8, 0.6]
    moves = moves_through(position, DT)
    save_program([moves], "XY", tmp_path)
    contour, feed, *_ = read_gcode(tmp_path / PROGRAM, "XY")
    ends = np.append(0.0, np.cumsum(np.asarray(contour.extent)[np.asarray(contour.mask)]))
    lasting = np.diff(ends) / feed
    played = np.interp(time, np.append(0.0, np.cumsum(lasting)), ends)
    assert np.abs(played - way).max() < CHORD + 1e-8 and len(feed) < 90
    jumps = np.abs(np.diff(feed)) / ((lasting[1:] + lasting[:-1]) / 2)
    assert jumps.max() < 1.001 * most
    assert 0.8 * jumps.max() == pytest.approx(moves.acceleration, rel=1e-3)  # X has most of it


def test_slow_moves_of_few_digits_take_their_time(tmp_path):
    """20 s at 20 um/s: of every move the digits of its place leave a hundredth."""
    time = DT * np.arange(20001)
    position = np.stack([2e-5 * time, 1e-6 * np.sin(20 * time)], axis=1)
    save_program([moves_through(position, DT)], "XY", tmp_path)
    contour, feed, *_ = read_gcode(tmp_path / PROGRAM, "XY")
    lasting = np.asarray(contour.extent)[np.asarray(contour.mask)] / feed
    assert lasting.sum() == pytest.approx(time[-1], rel=1e-6)


def test_the_distance_is_that_of_the_program_as_it_is_read_back(tmp_path):
    """Twenty seconds at about 30 mm/s in two directions: feeds of six digits alone would drift."""
    time = DT * np.arange(20001)
    way = 3e-2 * time + 1e-4 * np.sin(7 * time)
    position = np.stack([way, 0.3 * way + 2e-4 * np.sin(3 * time)], axis=1)
    moves = moves_through(position, DT)
    save_program([moves], "XY", tmp_path)
    contour, feed, *_ = read_gcode(tmp_path / PROGRAM, "XY")
    arrived = np.append(0.0, np.cumsum(np.asarray(contour.extent)[: len(feed)] / feed))
    begun = np.asarray(contour.position(np.asarray(contour.start)[: len(feed)]))
    places = np.vstack([begun, np.asarray(contour.position(contour.length))])
    on = np.stack([np.interp(time, arrived, axis) for axis in places.T], axis=1)
    apart = np.linalg.norm(on - position, axis=1).max()
    assert arrived[-1] == pytest.approx(time[-1], abs=1e-6)
    assert apart == pytest.approx(moves.chord, abs=1e-10) and apart <= CHORD


def test_a_corner_is_not_cut():
    position = 1e-5 * np.array([[k, 0] for k in range(100)] + [[99, k] for k in range(1, 100)])
    moves = moves_through(position.astype(float), DT)
    corner = np.linalg.norm(moves.ends - [99e-5, 0.0], axis=1).min()
    assert corner < 1e-12 and moves.chord < 1e-10


def test_a_rest_is_a_dwell_that_is_read_back(tmp_path):
    position = 1e-5 * np.arange(101)[:, None] * [1.0, 0.0]
    rested = np.concatenate([position, np.tile(position[-1], (70, 1)), position[-1] + position])
    moves = moves_through(rested, DT)
    assert np.sum(moves.lasting) == pytest.approx(DT * (len(rested) - 1))
    save_program([moves], "XY", tmp_path)
    toolpath = read_gcode(tmp_path / PROGRAM, "XY")
    at = np.flatnonzero(~np.isnan(toolpath.rest))
    # 70 samples, and the sample in which the second half begins where the first one ends
    np.testing.assert_allclose(toolpath.rest[at], [71 * DT], rtol=1e-9)
    place = toolpath.contour.position(np.asarray(toolpath.contour.start)[at + 1])
    np.testing.assert_allclose(place, [[1e-3, 0.0]], atol=1e-12)


def test_the_program_is_read_back_as_the_path(tmp_path):
    position = spiral()
    save_program([moves_through(position, DT)], "XY", tmp_path)
    contour, feed, *_ = read_gcode(tmp_path / PROGRAM, "XY")
    length = np.sum(np.linalg.norm(np.diff(position, axis=0), axis=1))
    assert float(contour.length) == pytest.approx(length, rel=1e-4)
    foot = contour.nearest_anywhere(position[::50])
    away = np.linalg.norm(np.asarray(contour.position(foot)) - position[::50], axis=1)
    assert away.max() < CHORD + 1e-8
    speed = np.linalg.norm(np.diff(position, axis=0), axis=1) / DT
    assert np.nanmin(feed) > 0.99 * speed.min() and np.nanmax(feed) < 1.01 * speed.max()


def test_samples_are_in_mm_with_their_time(tmp_path):
    position = spiral(5)
    save_samples(position, DT, "XY", tmp_path)
    assert (tmp_path / SAMPLES).read_text().startswith("time_s,X_mm,Y_mm\n0.000000,10.0000000,")
    rows = np.loadtxt(tmp_path / SAMPLES, delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 0], DT * np.arange(5), atol=1e-9)
    np.testing.assert_allclose(1e-3 * rows[:, 1:], position, atol=1e-10)


def test_it_is_told_which_samples_are_cut(tmp_path):
    save_samples(spiral(4), DT, "XY", tmp_path, cut=np.array([True, True, False, True]))
    header, *rows = (tmp_path / SAMPLES).read_text().splitlines()
    assert header == "time_s,X_mm,Y_mm,cut"
    assert [row.rpartition(",")[2] for row in rows] == ["1", "1", "0", "1"]


def test_comments_are_plain_and_short(tmp_path):
    moves = moves_through(spiral(50), DT)
    head = ["bent from part (2); old.ngc", "for Fräse", "x" * 400]
    save_program([moves], "XY", tmp_path, head)
    lines = (tmp_path / PROGRAM).read_bytes().decode("ascii").splitlines()
    assert lines[:2] == ["(bent from part [2], old.ngc)", "(for Fr?se)"]
    assert max(map(len, lines)) <= 255  # of LinuxCNC
    assert read_gcode(tmp_path / PROGRAM, "XY").rapid.sum() == 0
