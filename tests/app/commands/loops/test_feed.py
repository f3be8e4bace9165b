"""`feed` from the command line."""

import math
import re
from dataclasses import asdict

import pytest

from jcontour.app.cli import main
from jcontour.app.files.results.feed_result import FeedResult
from jcontour.app.files.results.simulated_result import SimulatedResult
from jcontour.app.files.results.stored import read_result


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
