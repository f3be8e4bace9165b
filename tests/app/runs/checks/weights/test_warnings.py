"""What `jcontour tune` warns of."""

import numpy as np
import pytest

from jcontour.app.runs.checks.weights.warnings import (
    idle_warnings,
    lag_warnings,
    margin_warnings,
    search_warnings,
    slow_warnings,
)
from tests.app import small_runs

FOUND = small_runs.tuned()


def margins(radius=0.99, delay=2, left_out=0, without=()):
    return small_runs.margins(
        spectral_radius=radius,
        delay_samples=delay,
        probes_left_out=left_out,
        contours_without_margins=tuple(without),
    )


def test_a_search_that_has_not_ended_is_told():
    assert search_warnings(FOUND) == []
    (line,) = search_warnings(FOUND._replace(stationary=False))
    assert "--steps" in line and "--every-start" in line


def test_weights_without_effect_are_named():
    assert idle_warnings(()) == []
    (line,) = idle_warnings(("ff",))
    assert line.startswith("ff has no effect on these runs and is left at the start")
    (line,) = idle_warnings(("ff", "lead"))
    assert line.startswith("ff, lead have no effect on these runs and are left")


def test_a_mode_that_outlasts_the_runs_is_told():
    """0.99 is left of a mode after a sample: a third, 1 / e, after 99.5 samples."""
    assert slow_warnings(margins(radius=0.99), longest=100, dt=1e-3) == []
    (line,) = slow_warnings(margins(radius=0.99), longest=99, dt=1e-3)
    assert "99.5 samples (99.5 ms)" in line and "the longest contour has 99" in line
    assert slow_warnings(margins(radius=1.0), longest=99, dt=1e-3) == []  # told as unstable
    assert slow_warnings(margins(radius=0.0), longest=99, dt=1e-3) == []


@pytest.mark.parametrize(
    ("delay", "unknown", "warned"), [(2, 2, False), (1, 2, True), (0, 1, True), (1, 0, False)]
)
def test_a_loop_that_does_not_bear_the_delay_of_its_machine(delay, unknown, warned):
    lines = margin_warnings(margins(delay=delay), unknown)
    assert (
        lines == []
        if not warned
        else len(lines) == 1 and lines[0].startswith(f"{delay + 1} sample") and "ring" in lines[0]
    )


def test_a_loop_that_bears_no_delay_is_told_where_none_is_stated():
    (line,) = margin_warnings(margins(delay=0), 0)
    assert "one more sample of delay" in line and "--min-delay-margin 1" in line
    assert margin_warnings(margins(delay=1), 0) == []
    assert margin_warnings(margins(delay=0), 0, asked=1) == []  # a reason tells of it


def test_an_unstable_loop_is_said_once():
    assert margin_warnings(margins(radius=1.1, delay=-1), 2) == [
        "with its gains frozen at a point of the training paths the loop is unstable"
    ]


def test_open_loops_are_counted_and_without_any_other_there_are_no_margins():
    assert "leave out 3 probed points where" in margin_warnings(margins(left_out=3), 0)[0]
    assert "leave out 1 probed point where" in margin_warnings(margins(left_out=1), 0)[0]
    [line] = margin_warnings(margins(radius=1.0, delay=-1, without=["ring", "eight"]), 2)
    assert line.startswith(
        "there are no margins: at every probed point of ring, eight a control is at its limit"
    )


def test_what_the_search_missed_is_named():
    assert search_warnings(FOUND) == []
    missed = FOUND._replace(
        stabilised=True, diverged_points=2, history=[None] * 9, diverged_starts=1
    )
    stabilised, points, starts = search_warnings(missed)
    assert stabilised.startswith("the start was unstable")
    assert points.startswith("2 of 9 evaluated points") and starts.startswith("1 descents")


def test_a_tool_left_behind_is_told():
    """Two contours on two plants; the last of the lags is given."""

    def run(lag):
        return small_runs.replay(
            6, (2, 2), rms_tracking_error=np.array([[1e-5, 1e-5], [1e-5, lag]])
        )

    counted = np.ones((2, 6), bool)
    jobs = [small_runs.job(name, counted[0]) for name in ("ring", "eight")]
    seen = small_runs.scenarios(jobs, np.zeros((2, 6, 2)), counted)
    assert lag_warnings({"start": run(1e-5), "tuned": run(4.9e-5)}, seen) == []
    [line] = lag_warnings({"start": run(1e-5), "tuned": run(1e-3)}, seen)
    assert "1000 um" in line and "on eight" in line
