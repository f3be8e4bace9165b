"""What is printed of a traversal, and what is advised."""

from dataclasses import replace

import pytest

from jcontour.app.files.results.traversed_result import Asked, Traversed
from jcontour.app.files.results.verdict import LimitCheck
from jcontour.app.reports.tables import console_of
from jcontour.app.reports.traversed_tables import advice, next_steps, show, verdict_on

TABLE = Asked(0.3, 200.0, (60.0, 60.0), 7, 4.0, 250.0)
FINE = replace(TABLE, r_control=(0.15, 0.15), period_ms=1.0)  # a horizon of 7 ms


def late_result(asked=TABLE, **fields):
    """A run of 3 mm that did not arrive, as it is told."""
    given = {"plant": "table", "contour": "line", "control_unit": "V", "length_mm": 3.0}
    ran = {"failure": "", "steps": 9, "fallbacks": 0, "limited": 0.0, "residual": 0.0}
    return Traversed(**given, **ran, asked=asked, **{"arrived": False, "time_s": None, **fields})


def test_how_far_a_late_tool_came_is_told_and_no_error(capsys):
    show(late_result(came_mm=1.25, end_mm=1.75), console_of())
    told = capsys.readouterr().out
    assert "Tool came         1.25 mm of 3 mm along the path; 1.75 mm from its end point" in told
    assert "DID NOT ARRIVE" in told and "RMS" not in told


def test_a_larger_limit_is_advised_where_the_controls_are_at_it():
    apart = late_result(control_used=(0.006, 11.0), control_limit=(300.0, 12.0))
    assert advice(apart) == "a larger --max-control allows it"


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (replace(TABLE, q_theta=0.0), "more --q-theta rewards progress, 0.3 say"),
        # 15 / 10^2 is the usual weight at a limit of 10, and 28 steps of 1 ms are Lam's 28 ms
        (
            replace(FINE, r_control=(60.0, 60.0)),
            "less --r-control, 0.15 say, lets the controls change faster, --horizon 28 sees more "
            "of it: they used at most 0.02 of 10 V",
        ),
        (
            replace(FINE, horizon=28),
            "less --r-control, 0.015 say, lets the controls change faster: "
            "they used at most 0.02 of 10 V",
        ),
    ],
)
def test_what_makes_a_slow_tool_faster_is_named_with_a_value(asked, says):
    slow = late_result(asked, control_used=(0.02, 0.0), control_limit=(10.0, 10.0))
    assert advice(slow) == says


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (
            replace(TABLE, q_theta=1000.0),
            "less --q-theta, 100 say, rewards progress less than it costs",
        ),
        (replace(TABLE, q_lag=0.0), "--q-lag 200 ties progress to the tool"),
        (FINE, "--horizon 28 looks 28 ms ahead, as in the paper"),
    ],
)
@pytest.mark.parametrize("lost", [{"outrun": True}, {"left_mm": 7.0}])
def test_a_tool_that_is_left_behind_is_never_advised_more_progress(asked, says, lost):
    full = {"control_used": (9.0,), "control_limit": (9.0,)}
    assert advice(late_result(asked, **lost, **full)) == says


def test_a_tool_that_overran_the_end_is_advised_to_brake():
    beside = late_result(rms_um=235.0, peak_um=890.0, control_used=(9.0,), control_limit=(9.0,))
    assert "a longer --horizon brakes in time, 14 say" in advice(beside)
    assert "less --q-theta is slower, 0.03 say" in advice(beside)


def test_a_tool_that_is_not_where_its_controller_held_it_is_told(capsys):
    found = late_result(outrun=True, came_mm=0.1, end_mm=0.0, progress_mm=3.0)
    show(found, console_of())
    assert "DID NOT ARRIVE" in capsys.readouterr().out
    (behind,) = verdict_on(found).reasons
    assert "LEFT THE TOOL BEHIND: it came to 3 mm of 3 mm, the tool 0.1 mm" in behind
    (left,) = verdict_on(late_result(outrun=True, left_mm=170.0, end_mm=170.0)).reasons
    assert left == "the tool LEFT the path: it was 170 mm off one of 3 mm"


def test_a_tool_that_arrives_within_its_limits_ends_with_code_0_and_any_other_with_3():
    speed = LimitCheck(name="speed of X", value=0.19, allowed=0.2, unit="m/s")
    arrived = late_result(arrived=True, time_s=0.1, came_mm=3.0, end_mm=0.0, limits=[speed])
    assert verdict_on(arrived).exit_code == 0
    assert verdict_on(replace(arrived, arrived=False)).exit_code == 3
    found = replace(arrived, limits=[replace(speed, value=0.25)])
    assert verdict_on(found).exit_code == 3
    assert "a lower --max-speed-mm-s, 125 say" in next_steps(found)[-1]
