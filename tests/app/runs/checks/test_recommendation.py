"""Every fault of tuned weights is a reason against them, or a warning."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.files.results.tuned_result import RobustTest, TunedContour
from jcontour.app.files.results.verdict import LimitCheck
from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.checks.recommendation import (
    Evidence,
    active_limits,
    exceeded_most,
    flag_allowing,
    lag_warnings,
    margin_warnings,
    may_drift,
    verdict_on,
)
from jcontour.app.runs.tuning.limits import LeastKnown
from jcontour.simulation.limit_use import LimitUse
from tests.app import small_runs
from tests.app.small_runs import family_metrics, margins, partly
from tuning.objectives import COUNT_NOISE, AtMost, LoopPeaks, Outcome
from tuning.problem import Problem
from tuning.tuner import Price


def end_of_search(feasible=True, violation=-0.1, sensitivity=1.9):
    loops = LoopPeaks(*(np.full((2, 2), value) for value in (sensitivity, 1.2, 0.9, 0.0)))
    outcome = Outcome(small_runs.metrics((2, 2)), loops)
    return small_runs.tuned(outcome=outcome, feasible=feasible, violation=violation)


def contour(name, training, start, tuned, diverged=False):
    before, after = family_metrics(start), family_metrics(tuned, diverged=diverged)
    metrics = {"start": before, "tuned": after}
    return TunedContour(name=name, training=training, samples=10, metrics=metrics)


BEYOND = LimitCheck(name="speed of X", value=0.3, allowed=0.2, unit="m/s")
GOOD = [contour("part", True, 3e-6, 1e-6), contour("circle", False, 2e-6, 1e-6)]
SOUND = RobustTest(members=1000, diverged=0, error=2e-6, contour="part")


def reasons(**changes):
    return verdict_on(evidence(**changes)).reasons


def warnings(**changes):
    return verdict_on(evidence(**changes)).warnings


def evidence(**changes):
    given = {
        "tuned": end_of_search(),
        "contours": GOOD,
        "margins": margins(),
        "robust": SOUND,
        "error": "contour",
    }
    return Evidence(**{**given, **changes})


def test_nothing_speaks_against_a_loop_that_is_better_everywhere():
    assert reasons() == [] and reasons(robust=None) == []


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"margins": margins(spectral_radius=1.0)}, "unstable"),
        ({"robust": SOUND.__class__(members=1000, diverged=1, error=1.0, contour="part")}, "1 of"),
        ({"contours": [*GOOD, contour("square", False, 1.0, 1.0, True)]}, "diverges on square"),
        ({"delay": 4}, "bears 3 samples of delay"),
        ({"unmeasured": ["X"]}, "nothing of the response of X is measured"),
    ],
)
def test_each_fault_is_one_line(changes, words):
    (line,) = reasons(**changes)
    assert words in line


def test_a_loop_that_drifts_is_no_loop():
    """Contours of 10 samples: ten times as long are 100, and the radius for that is 0.99."""
    assert not may_drift(margins(spectral_radius=0.9899), GOOD) and may_drift(
        margins(spectral_radius=0.9901), GOOD
    )
    assert not may_drift(margins(spectral_radius=1.0), GOOD)  # unstable: reported as that
    assert reasons(margins=margins(spectral_radius=1 - 1e-7), lasting=99.0) == []
    (line,) = reasons(lasting=1e7)
    assert "the feedback does next to nothing" in line and "takes 1e+07 samples" in line
    (line,) = reasons(lasting=np.inf)
    assert "stays there" in line


def test_a_loop_that_rests_on_what_no_record_shows_is_not_loaded():
    """The frequency, what is reached there, what is safe, and the record to make."""
    (line,) = reasons(unknown=LeastKnown(hertz=38.2, relative=5.0, complementary=0.31))
    for words in ("38.2 Hz", "sensitivity there is 0.31", "at most 0.1 is safe", "--excite"):
        assert words in line


def test_weights_that_saw_a_single_plant_are_not_loaded():
    (line,) = reasons(alone=True)
    assert "tried on a single plant" in line and "UNCERTAINTY" in line


@pytest.mark.parametrize(("law", "calmer"), [("trapezoidal", True), ("jerk", False)])
def test_what_asks_for_less_is_reported_where_a_limit_is_exceeded(law, calmer):
    first, second = reasons(limits=[BEYOND], feed_law=law)
    assert first.startswith("speed of X EXCEEDS its limit: 18000 of 12000 mm/min")
    assert "--acceleration" in second and ("--feed-law jerk" in second) is calmer


def test_held_out_contours_that_became_worse_are_named_before_training_ones():
    worse = [contour("cam", True, 1e-6, 1.6e-6), contour("ellipse", False, 2e-6, 3e-6)]
    first, second = reasons(contours=[*GOOD, *worse])
    assert "held-out contours: ellipse x 1.50:" in first
    assert "training contours: cam x 1.60:" in second


def test_less_than_a_per_cent_is_not_worse():
    assert reasons(contours=[*GOOD, contour("cam", True, 1e-6, 1.009e-6)]) == []


def test_what_the_encoders_cannot_tell_is_reported_and_no_reason():
    worse = [contour("cam", True, 3e-6, 3.1e-6), contour("ellipse", False, 2e-6, 3e-6)]
    (line,) = reasons(contours=[*GOOD, *worse], finest=0.2e-6)
    assert "ellipse x 1.50" in line and "cam" not in line
    (line,) = warnings(contours=[*GOOD, worse[0]], finest=0.2e-6)
    assert line.endswith("less than the rounding of the encoders, 0.2 um: cam x 1.03")
    assert warnings(contours=[*GOOD, *worse], finest=0.2e-6) == warnings(contours=GOOD) == []
    near = [*GOOD, contour("square", False, 20e-6, 21e-6)]
    (line,) = warnings(contours=near, finest=0.2e-6)
    assert line == "a little worse than the start: square x 1.05" and not reasons(contours=near)


def test_a_contour_may_pay_less_than_all_gain_in_the_mean():
    """Means of x 0.89 and x 0.75: one contour that grows by a fifth is more than the first."""
    for gained, usable in ((1.3, False), (1.7, True)):
        others = [contour(name, True, gained * 1e-6, 1e-6) for name in ("part", "circle")]
        seen = [*others, contour("square", True, 1e-6, 1.2e-6)]
        assert (not reasons(contours=seen)) is usable
    (line,) = warnings(contours=seen)
    assert line.endswith("the geometric mean of all contours is x 0.75: square x 1.20")


def test_weights_that_are_worse_in_all_are_not_used_however_little_it_is():
    """Worse by 4, 13 and 38 %, each less than the encoders can tell; the start keeps its limits."""
    worse = [contour("part", True, 1e-6, 1.04e-6), contour("circle", False, 1e-6, 1.13e-6)]
    worse.append(contour("square", False, 1e-6, 1.38e-6))
    (line,) = reasons(contours=worse, finest=1.4e-6)
    assert "worse than the start in all" in line and "x 1.17" in line  # (1.04 1.13 1.38)^(1/3)
    even = [*worse, contour("cam", False, 1.7e-6, 1e-6)]
    assert reasons(contours=even, finest=1.4e-6) == []


START = LimitCheck(name="acceleration of X", value=1.51, allowed=0.5, unit="m/s^2")


def test_a_start_that_breaks_a_limit_is_no_loop_to_compare_with():
    worse = [contour("part", True, 1e-6, 2e-6)]
    kept = replace(START, value=0.47)
    seen = evidence(contours=worse, limits=[kept], start_limits=[START])
    verdict = verdict_on(seen)
    assert verdict.usable and seen.compared == ""
    assert "start: not usable, acceleration of X 1.51 of 0.5 m/s^2; tuned 0.47" in verdict.warnings
    (line,) = reasons(contours=worse, limits=[kept], start_limits=[kept])
    assert "worse than the start on training contours: part x 2.00" in line


def test_without_a_usable_start_the_best_simple_loop_is_what_tuned_weights_have_to_beat():
    one = contour("part", True, 1e-6, 2e-6)
    simple = family_metrics(1.5e-6)
    beside = [replace(one, metrics={**one.metrics, "baseline": simple})]
    (line,) = reasons(contours=beside, start_limits=[START], baseline="baseline")
    assert "worse than the baseline on training contours: part x 1.33" in line


def restless(start, tuned, times, increment=1e-6):
    """A contour whose control changes so many times as much on its worst plant."""
    before = family_metrics(start, rms_increment=increment)
    after = family_metrics(tuned, rms_increment=times * increment)
    metrics = {"start": before, "tuned": after}
    return replace(contour("cam", True, start, tuned), metrics=metrics)


def test_a_restless_control_needs_a_gain_that_the_encoders_can_tell():
    (line,) = reasons(contours=[restless(1.0e-6, 0.9e-6, 30.0)], finest=0.2e-6)
    assert "0.2 um" in line and "30 times" in line and "--max-rms-increment 2e-06" in line
    assert reasons(contours=[restless(1.0e-6, 0.9e-6, 4.9)], finest=0.2e-6) == []
    assert reasons(contours=[restless(1.0e-6, 0.7e-6, 30.0)], finest=0.2e-6) == []
    one_gains = [restless(1.0e-6, 0.9e-6, 30.0), restless(1.0e-6, 0.7e-6, 30.0)]
    assert reasons(contours=one_gains, finest=0.2e-6) == []
    assert reasons(contours=[restless(1.0e-6, 0.9e-6, 30.0)], finest=0.0) == []
    still = restless(1.0e-6, 0.9e-6, 1.0, increment=0.0)
    assert reasons(contours=[still], finest=0.2e-6) == []


def test_a_limit_that_is_not_kept_is_reported_with_the_peak_that_was_found():
    limit, violation = "peak_sensitivity", math.log(1.3)
    allowing = flag_allowing(limit, violation, Tune(), {limit: 2.0})
    (line,) = reasons(tuned=end_of_search(False, violation, 2.6), limit=limit, allowing=allowing)
    assert "peak sensitivity by 30 %" in line and line.endswith("--max-sensitivity 2.6")


@pytest.mark.parametrize(
    ("limit", "flags", "bound", "flag"),
    [
        ("rms_control", Tune(), 0.5, "--max-rms-control 1"),
        ("rms_control", Tune(max_effort=1.2), 0.5, "--max-effort 2.4"),
        (COUNT_NOISE, Tune(max_count_noise=0.01), 0.1, "--max-count-noise 0.02"),
        ("peak_increment", Tune(), 0.0617264, "--max-peak-increment 0.124"),
        ("late_radius", Tune(), 0.999, ""),
    ],
)
def test_the_flag_that_allows_twice_the_bound(limit, flags, bound, flag):
    assert flag_allowing(limit, math.log(2), flags, {limit: bound}) == flag
    assert flag_allowing(limit, math.inf, flags, {limit: bound}) == ""


@pytest.mark.parametrize(
    "limit, flag",
    [
        ("acceleration_use", "more acceleration than the machine has; try 10 % less feed"),
        ("increment_use", "more change of its control than the machine has"),
        ("late_radius", "--min-delay-margin"),
        ("error_ratio", "--max-error-ratio 1.3"),
        ("rms_tracking_error", "--max-tracking-error-um 130"),
    ],
)
def test_only_the_limit_that_is_exceeded_is_spoken_of(limit, flag):
    """Neither the sensitivity, nor contours that weights beyond a limit make worse."""
    worse = [*GOOD, contour("cam", True, 1e-6, 9e-6)]
    tuned, bounds = (
        end_of_search(False, math.log(1.3), 1.08),
        {"error_ratio": 1, "rms_tracking_error": 1e-4},
    )
    allowing = flag_allowing(limit, tuned.violation, Tune(), bounds)
    (line,) = reasons(tuned=tuned, contours=worse, limit=limit, allowing=allowing)
    assert flag in line and "max-sensitivity" not in line and "--objective" not in line


def test_the_limit_that_is_exceeded_most_is_found(proportional):
    problem, outcome = proportional
    assert exceeded_most(problem, end_of_search()._replace(outcome=outcome)) == ""
    assert (
        exceeded_most(problem, end_of_search(False)._replace(outcome=outcome)) == "peak_sensitivity"
    )


@pytest.fixture
def proportional():
    """A problem of two limits; the loops are farther beyond theirs than the runs."""
    loops = LoopPeaks(*(np.array([[1.5, value]]) for value in (4.0, 1.2, 0.9, 0.0)))
    limits = AtMost(acceleration_use=0.5, peak_sensitivity=2.0)
    use = LimitUse(*(np.array([[0.6, 0.7]]) for _ in range(4)))
    problem = partly(Problem, limits=limits, limit_entries=limits.entries)
    return problem, Outcome(None, loops, use)  # pyright: ignore[reportArgumentType]


def test_prices_of_one_limit_are_added_and_free_ones_left_out():
    """Halving what one limit costs elsewhere does not change what it is worth in all."""
    prices = [
        Price("peak_sensitivity", 0, 0, 0.3),
        Price("peak_sensitivity", 4, 1, 0.2),
        Price("rms_control", 0, 0, 0.8),
        Price("rms_increment", 0, 0, 0.0),
    ]
    bounds = {"peak_sensitivity": 2.0, "rms_control": 0.1, "rms_increment": 1.0}
    active = active_limits(prices, bounds)
    assert [one.name for one in active] == ["rms_control", "peak_sensitivity"]
    assert active[1].price == pytest.approx(0.5) and active[1].bound == 2.0


@pytest.mark.parametrize(("there", "asked"), [(None, 1.7), (3.0, 1.7), (1.7, 1.4), (1.05, 1.1)])
def test_more_margin_is_more_than_there_is(there, asked):
    lost = RobustTest(members=1000, diverged=2, error=1e-6, contour="square")
    few = margins(sensitivity=there)
    (reason,) = reasons(contours=[contour("square", True, 2e-6, 1e-6)], margins=few, robust=lost)
    assert reason.endswith(f"--max-sensitivity {asked}")


def frozen_margins(radius=0.99, delay=2, left_out=0, without=()):
    return small_runs.margins(
        spectral_radius=radius,
        delay_samples=delay,
        probes_left_out=left_out,
        contours_without_margins=tuple(without),
    )


def of_margins(*given, longest=100, dt=1e-3, asked=0):
    """Warnings of margins, of contours that outlast their modes."""
    return [one.line for one in margin_warnings(*given, longest, dt, asked)]


def test_a_mode_that_outlasts_the_runs_is_reported():
    """0.99 is left of a mode after a sample: a third, 1 / e, after 99.5 samples."""
    assert of_margins(frozen_margins(radius=0.99), 0, longest=100) == []
    (line,) = of_margins(frozen_margins(radius=0.99), 0, longest=99)
    assert "99.5 samples (99.5 ms)" in line and "the longest contour has 99" in line
    assert len(of_margins(frozen_margins(radius=1.0), 0, longest=99)) == 1  # reported as unstable
    assert of_margins(frozen_margins(radius=0.0), 0, longest=99) == []


@pytest.mark.parametrize(
    ("delay", "unknown", "warned"), [(2, 2, False), (1, 2, True), (0, 1, True), (1, 0, False)]
)
def test_a_loop_that_does_not_bear_the_delay_of_its_machine(delay, unknown, warned):
    lines = of_margins(frozen_margins(delay=delay), unknown)
    assert (
        lines == []
        if not warned
        else len(lines) == 1 and lines[0].startswith(f"{delay + 1} sample") and "ring" in lines[0]
    )


def test_a_loop_that_bears_no_delay_is_reported_where_none_is_stated():
    (line,) = of_margins(frozen_margins(delay=0), 0)
    assert "one more sample of delay" in line and "--min-delay-margin 1" in line
    assert of_margins(frozen_margins(delay=1), 0) == []
    assert of_margins(frozen_margins(delay=0), 0, asked=1) == []  # a reason tells of it


def test_an_unstable_loop_is_said_once():
    assert of_margins(frozen_margins(radius=1.1, delay=-1), 2) == [
        "with its gains frozen at a point of the training paths the loop is unstable"
    ]


def test_open_loops_are_counted_and_without_any_other_there_are_no_margins():
    assert "leave out 3 probed points where" in of_margins(frozen_margins(left_out=3), 0)[0]
    assert "leave out 1 probed point where" in of_margins(frozen_margins(left_out=1), 0)[0]
    [line] = of_margins(frozen_margins(radius=1.0, delay=-1, without=["ring", "eight"]), 2)
    assert line.startswith(
        "there are no margins: at every probed point of ring, eight a control is at its limit"
    )


def test_a_tool_left_behind_is_reported():
    """Two contours on two plants; the last of the lags is given."""

    def run(lag):
        return small_runs.replay(
            6, (2, 2), rms_tracking_error=np.array([[1e-5, 1e-5], [1e-5, lag]])
        )

    counted = np.ones((2, 6), bool)
    jobs = [small_runs.job(name, counted[0]) for name in ("ring", "eight")]
    seen = small_runs.scenarios(jobs, np.zeros((2, 6, 2)), counted)
    assert [*lag_warnings({"start": run(1e-5), "tuned": run(4.9e-5)}, seen)] == []
    (message,) = lag_warnings({"start": run(1e-5), "tuned": run(1e-3)}, seen)
    assert "1000 um" in message.text and "on eight" in message.text
