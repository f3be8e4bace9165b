"""Which feed is recommended, and feeds that are what they say. `feed` from the command line."""

import math
import re
from dataclasses import asdict, replace

import pytest

from jcontour.app.cli import main
from jcontour.app.commands.loops.feed import next_steps, recommended, show, verdict_on
from jcontour.app.files.results.loop_results import FeedPoint, FeedResult, SimulatedResult
from jcontour.app.files.results.run_metrics import MachineSummary
from jcontour.app.files.results.stored import read_result
from jcontour.app.files.results.verdict import LimitCheck, Verdict
from jcontour.app.jobs.job import at_constant_feed, from_file
from jcontour.app.jobs.pace import Pace
from jcontour.app.machines.built_in import bridgeport_machine
from jcontour.app.reports import tables
from jcontour.geometry.contours import circle
from tests.app import small_runs


def point(override, cycle_time, peak_um, **changes):
    given = {"override": override, "cycle_time": cycle_time, "diverged": [], "limits": []}
    return FeedPoint(**given | {"metrics": small_runs.family_metrics(1e-6 * peak_um)} | changes)


BEYOND = LimitCheck(name="speed of X", value=0.3, allowed=0.2)
POINTS = [point(50, 10.0, 2.0), point(100, 5.2, 5.0), point(200, 4.9, 12.0)]


def test_the_quickest_within_the_tolerance():
    best, reason = recommended(POINTS, "contour", 6e-6)
    assert best is POINTS[1] and "within 6 um" in reason
    assert recommended(POINTS, "contour", 20e-6)[0] is POINTS[2]
    none, reason = recommended(POINTS, "contour", 1e-6)
    assert none is None and "least largest error is 2 um" in reason


def test_a_quicker_feed_with_no_more_error_always_pays():
    points = [point(50, 0.75, 1.68), point(100, 0.535, 1.63)]  # 29 % of the time for twice the feed
    best, reason = recommended(points, "contour", None)
    assert best is points[1] and "no slower one has less error" in reason
    assert recommended([points[0], point(100, 0.535, 1.7)], "contour", None)[0] is points[0]


def result(tolerance, deviation, tuned):
    return result_of([replace(one, deviation=deviation) for one in POINTS], tolerance, tuned)


def result_of(points, tolerance, tuned):
    best, reason = recommended(points, "contour", tolerance)
    return FeedResult(
        machine=MachineSummary("mill", "V", ("X", "Y"), "counts"),
        controller="mine",
        contour="part",
        error="contour",
        tolerance=tolerance,
        points=points,
        recommended=None if best is None else best.override,
        verdict=verdict_on(best, reason, points, "contour", tolerance),
        tuned=tuned,
    )


def test_a_tolerance_that_the_corners_use_up_is_told_with_the_flag_that_helps():
    found = result(1.5e-6, 1.98e-6, tuned=False)
    assert "the corners are blended within 1.98 um" in found.verdict.reasons[0]
    [(_, line)] = next_steps(found)
    assert "--corner-tolerance-um 0.75" in line and "tune" not in line
    assert "corners" not in result(1.5e-6, 0.5e-6, tuned=False).verdict.lines[1]


def test_without_a_tolerance_feed_has_to_come_off_the_cycle_time():
    """From 100 to 200 %: 6 % of the time for 2.4 times the error."""
    best, reason = recommended(POINTS, "contour", None)
    assert best is POINTS[1]
    assert "100 % more feed takes 6 % off the cycle time, with 140 % more error" in reason


def test_where_every_rise_takes_time_off_only_a_tolerance_names_a_feed():
    """At constant feed the time is exactly inverse to the feed, and 50 to 100 % nearly so."""
    constant = [point(feed, 500 / feed, 0.1 * feed) for feed in (25, 50, 100, 200)]
    for points in (constant, POINTS[:2]):
        none, reason = recommended(points, "contour", None)
        assert none is None and reason.endswith("the largest error that the part allows")
        [(_, line)] = next_steps(result_of(points, None, tuned=False))
        assert "--tolerance-um" in line
    assert recommended(constant, "contour", 11e-6)[0] is constant[2]


def test_where_every_rise_pays_the_limits_of_the_machine_decide():
    points = [POINTS[0], POINTS[1], replace(POINTS[2], limits=[BEYOND])]
    best, reason = recommended(points, "contour", None)
    assert best is POINTS[1] and "follows within its limits" in reason
    best, reason = recommended(points[:1], "contour", None)
    assert best is POINTS[0] and "the only one" in reason


def test_a_feed_that_a_plant_does_not_follow_is_never_recommended():
    lost = [POINTS[0], replace(POINTS[1], diverged=["nominal"])]
    assert recommended(lost, "contour", 1.0)[0] is POINTS[0]
    beyond = [replace(one, limits=[BEYOND]) for one in POINTS]
    none, reason = recommended(beyond, "contour", 1.0)
    assert none is None and "a limit of the machine is exceeded" in reason


def test_an_override_scales_programmed_feeds_and_leaves_rapid_moves(tmp_path):
    program = tmp_path / "part.ngc"
    program.write_text("G21 G90 G64 P0\nG0 X100\nG1 X200 F600\nX300 F1200\n")
    pace = Pace(bridgeport_machine(), None, 2.0, feed_law="trapezoidal")
    dt = pace.machine.model.dt

    def seconds(job):
        scored = job.scored.sum() * dt
        return job.samples * dt - scored, scored

    slow, usual = (seconds(from_file(program, pace._replace(override=one))) for one in (0.5, 1.0))
    assert usual[1] == pytest.approx(10 + 5, abs=0.1)
    assert slow[1] == pytest.approx(2 * usual[1], rel=0.01)
    circled = [
        at_constant_feed("circle", circle(1e-2), pace._replace(override=one)).samples
        for one in (0.5, 1.0)
    ]
    assert circled[0] == pytest.approx(2 * circled[1], rel=0.01)


def slower(feed, planned=()):
    """A point of which the motion itself exceeds what is given."""
    return point(feed, 1.0, 1.0, planned=[*planned])


def stated(points):
    return replace(result_of(points, None, False), verdict=Verdict.of([]), recommended=None)


def test_a_feed_at_which_the_tool_rests_is_not_recommended(capsys):
    resting = replace(slower(50), not_followed=["the tool moves 0 of 2 mm"])
    assert not resting.sound
    best, why = recommended([resting], "contour", 1e-3)
    assert best is None and "does not follow" in why
    show(replace(stated([resting]), recommended=None), tables.console_of())
    assert "50 %: the tool moves 0 of 2 mm" in capsys.readouterr().out


def test_a_stored_run_at_several_feeds(tour):
    found, once = tour("feed").result(FeedResult), tour("simulate").result(SimulatedResult)
    assert [one.override for one in found.points] == [50, 100]
    slow, usual = found.points
    assert slow.cycle_time > usual.cycle_time
    # padded to the slower run: the sweep of the gains is rounded otherwise
    expected = pytest.approx(asdict(once.plants["nominal"]), rel=1e-6)
    assert asdict(usual.metrics.nominal) == expected
    largest = max(one.peak_contour_error for one in once.plants.values())
    assert usual.metrics.worst.peak_contour_error == pytest.approx(largest, rel=1e-6)
    assert found.undecided and "feed.png" in tour("feed").files()


def test_a_tolerance_that_is_missing_is_no_failure(tmp_path, capsys):
    """A circle at constant feed: half the time at twice the feed, one lap of 2 pi mm."""
    out = tmp_path / "feed"
    flags = ["--plant", "bridgeport", "--preview", "4", "--overrides", "50", "100"]
    assert main(["feed", "circle", *flags, "--out", str(out)]) == 0
    found = read_result(out, FeedResult)
    assert found.recommended is None and found.undecided
    lap = 2e-3 * math.pi / 0.05
    assert [one.cycle_time for one in found.points] == pytest.approx([2 * lap, lap])
    assert "No feed is recommended" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ("circle --overrides 0", "overrides: a feed of 1 to 1000 % is needed"),
        ("circle --overrides -5", "overrides"),
        ("circle --tolerance-um 0", "tolerance-um: needs to be above zero"),
        ("task-a --plant flexible-axis", "feed: .* has one axis"),
        (".", "is not a run folder"),
    ],
)
def test_bad_input_is_one_line(flags, told, tmp_path, capsys):
    assert main(["feed", *flags.split(), "--out", str(tmp_path / "feed")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert re.search(told, line)
    assert not (tmp_path / "feed").exists()
