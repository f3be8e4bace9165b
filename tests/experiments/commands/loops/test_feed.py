"""`feed` from the command line."""

import math
import re
from dataclasses import asdict, replace

import pytest

from experiments.cli import main
from experiments.commands.loops.feed import next_steps, show
from experiments.files.results.feed_result import FeedPoint, FeedResult
from experiments.files.results.run_metrics import FamilyMetrics, MachineSummary, RunMetrics
from experiments.files.results.simulated_result import SimulatedResult
from experiments.files.results.stored import read_result
from experiments.files.results.verdict import LimitCheck, Verdict
from experiments.reports import tables
from experiments.runs.loops.feeds import recommended

BEYOND = LimitCheck(name="speed of X", value=0.3, allowed=0.2)
METRICS = RunMetrics(*[1e-6] * 11, diverged=False)


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


def test_what_the_motion_itself_exceeds_is_told_once(capsys):
    """With the feeds at which it does, in numbers of the quickest of them."""
    points = [point(25, []), point(50, ["slow"]), point(100, ["quick"])]
    show(result_of(points), tables.console_of())
    said = capsys.readouterr().out
    assert "WARNING: 50, 100 % (numbers of 100 %): quick" in said and "slow" not in said
    show(result_of(points[:2]), tables.console_of())
    assert "WARNING: 50 %: slow" in capsys.readouterr().out
    show(result_of(points[:1]), tables.console_of())
    assert "WARNING" not in capsys.readouterr().out


@pytest.mark.parametrize("planned", [["speed"], []])
def test_slower_feeds_are_no_help_where_the_motion_itself_exceeds_a_limit(planned):
    beyond = [replace(point(feed, planned), limits=[BEYOND]) for feed in (50, 100)]
    none = Verdict.of([], ["none will do"])
    [line] = next_steps(replace(result_of(beyond), recommended=None, verdict=none))
    assert ("slower --overrides" in line) is not bool(planned)


def test_a_feed_at_which_the_tool_rests_is_not_recommended(capsys):
    resting = replace(point(50, []), not_followed=["the tool moves 0 of 2 mm"])
    assert not resting.sound
    best, why = recommended([resting], "contour", 1e-3)
    assert best is None and "does not follow" in why
    show(replace(result_of([resting]), recommended=None), tables.console_of())
    assert "50 %: the tool moves 0 of 2 mm" in capsys.readouterr().out


def point(feed, planned):
    metrics = FamilyMetrics(METRICS, METRICS)
    return FeedPoint(
        override=feed, cycle_time=1.0, metrics=metrics, diverged=[], limits=[], planned=planned
    )


def result_of(points):
    return FeedResult(
        machine=MachineSummary("mill", "A", ("X", "Y"), "counts"),
        controller="pd",
        contour="part",
        error="contour",
        tolerance=None,
        points=points,
        recommended=points[-1].override,
        verdict=Verdict.of([], passed="USE it"),
    )


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
