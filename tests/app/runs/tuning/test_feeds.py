"""Feeds of a front: they are what they say, and the quickest within every limit is recommended."""

import re

import pytest

from jcontour.app.cli import main
from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.search_results import FrontResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.jobs.job import at_constant_feed, from_file
from jcontour.app.jobs.pace import Pace
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.geometry.contours import circle


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


def test_a_stored_run_at_several_feeds(tour):
    result, once = tour("front-feed").result(FrontResult), tour("simulate").result(SimulatedResult)
    slow, usual = result.points
    assert (slow.budget, usual.budget) == (50, 100) and slow.cycle_time > usual.cycle_time
    largest = max(one.peak_contour_error for one in once.plants.values())
    # padded to the slower run: the sweep of the gains is rounded otherwise
    assert usual.objective == pytest.approx(largest, rel=1e-6)
    assert result.recommended is None
    assert result.verdict is not None and result.verdict.usable


def test_the_quickest_feed_within_the_error_is_recommended(tour, tmp_path):
    slow, usual = tour("front-feed").result(FrontResult).points
    low, high = sorted(1e6 * one.objective for one in (slow, usual))

    def within(peak_um):
        out = tmp_path / f"{peak_um:g}"
        flags = f"--against feed --overrides 50 100 --max-peak-contour-error-um {peak_um!r}"
        code = main(["front", str(tour("simulate").folder), *flags.split(), "--out", str(out)])
        return code, read_result(out, FrontResult)

    code, result = within(1.01 * high)
    assert code == 0 and result.recommended == 100
    code, result = within(0.5 * low)
    assert code == 3 and result.recommended is None and result.verdict is not None
    assert any("peak contour error EXCEEDS" in one for one in result.verdict.reasons)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ("circle --overrides 0", "overrides: a feed of 1 to 1000 % is needed"),
        ("circle --max-peak-contour-error-um 0", "max-peak-contour-error-um: a limit needs"),
        ("task-a --plant flexible-axis", "against: .* has one axis"),
        ("circle --points 3", "points: --against feed searches no weights"),
        ("circle square", "runs one part, received 2"),
        (".", "is not a run folder"),
    ],
)
def test_bad_input_is_one_line(flags, message, tmp_path, capsys):
    where = ["--out", str(tmp_path / "feed")]
    assert main(["front", "--against", "feed", *flags.split(), *where]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert re.search(message, line)
    assert not (tmp_path / "feed").exists()
