"""Lam's paper: Fig. 13 against reference numbers, and the verdicts against made-up curves."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.papers.lam.claims import along_the_path, claims, contour, trade_off
from experiments.papers.lam.experiment import (
    CONTROLLERS,
    Point,
    Result,
    Trace,
    lobes,
    machines,
    point,
    traced,
    tracked,
)
from experiments.papers.lam.experiment import MPCC_4MS as MPCC
from experiments.papers.verdicts import Verdict
from jcontour.geometry.periodic_splines import polar_lobes

# computed by a program that shares no code with this project: q_theta -> RMS contour error in % of
# the largest radius, traversal time [s]
FRICTION_CURVE = {
    0.03: (0.0224, 4.32),
    0.1: (0.0331, 2.72),
    0.3: (0.0427, 2.13),
    1.0: (0.0491, 1.92),
    5.0: (0.0676, 1.86),
}


@pytest.mark.slow
@pytest.mark.parametrize("progress", FRICTION_CURVE)
def test_trade_off_on_the_friction_machine(progress):
    outcome, _ = traced(machines(1e-3)["friction"], lobes(), progress)
    row = point(MPCC, "friction", "", outcome, 40e-3)
    percent, time = FRICTION_CURVE[progress]
    assert row.finished
    np.testing.assert_allclose([row.rms_percent, row.time_s], [percent, time], rtol=5e-3)


YES, PARTLY, NO = Verdict.REPRODUCED, Verdict.IN_PART, Verdict.NOT_REPRODUCED
TIMES = (2.0, 3.0, 4.0)  # [s] of the made-up runs


def made_up(mpcc, others):
    """A result whose curves are the given errors [%] at 2, 3 and 4 s."""
    points = [
        Point(controller, "p", "", True, time, error)
        for controller in CONTROLLERS
        for time, error in zip(TIMES, mpcc if controller == MPCC else others, strict=True)
    ]
    bend = np.tile([0.0, 1.0], 50)
    line = np.column_stack([np.arange(100.0), np.zeros(100)])
    slow = Trace(
        q_theta=0.03,
        theta_mm=np.arange(-100.0, 0.0),
        tool_mm=line + [0.0, 0.1],
        foot_mm=line,
        control_a=0.1 * line,
        speed_mm_s=100 - 50 * bend,
        contour_error_um=np.ones(100),
        curvature_per_mm=bend,
    )
    fast = replace(slow, q_theta=5.0, speed_mm_s=200 - 50 * bend, contour_error_um=2 * np.ones(100))
    return Result(("p",), line, (slow, fast), tuple(points))


def verdicts(result):
    return [claim.verdict for claim in claims(result)]


@pytest.mark.parametrize(
    ("mpcc", "others", "expected"),
    [
        ((3.0, 2.0, 1.0), (9.0, 3.0, 1.1), [YES] * 6),
        # the others are ahead of MPCC at the middle of the range
        ((3.0, 2.0, 1.0), (9.0, 1.9, 1.1), [YES] * 5 + [PARTLY]),
        # every curve rises at its end; MPCC is behind where it is fast
        ((3.0, 2.0, 4.0), (1.0, 1.0, 9.0), [YES] * 2 + [NO] * 4),
        # of all curves MPCC's alone rises; it is a little better at both ends
        ((3.0, 2.0, 2.5), (4.0, 3.0, 2.6), [YES, YES, PARTLY, YES, PARTLY, YES]),
    ],
)
def test_verdicts_follow_the_numbers(mpcc, others, expected):
    assert verdicts(made_up(mpcc, others)) == expected


def test_a_run_that_does_not_arrive_is_in_no_curve():
    result = made_up((3.0, 2.0, 1.0), (9.0, 3.0, 1.1))
    lost = [replace(one, finished=False, time_s=np.inf) for one in result.trade_off]
    kept = [one for one in result.trade_off if one.controller != MPCC]
    without = replace(result, trade_off=(*kept, *(one for one in lost if one.controller == MPCC)))
    assert verdicts(without)[3:] == [NO] * 3


def test_figures_show_the_numbers():
    result = made_up((3.0, 2.0, 1.0), (9.0, 3.0, 1.1))
    panel = trade_off(result).axes[0]
    drawn = {line.get_label(): line for line in panel.lines}
    assert list(drawn) == list(CONTROLLERS)
    np.testing.assert_array_equal(drawn[MPCC].get_ydata(), [3.0, 2.0, 1.0])
    np.testing.assert_array_equal(drawn[MPCC].get_xdata(), TIMES)
    speed = along_the_path(result).axes[2]
    np.testing.assert_array_equal(speed.lines[1].get_ydata(), result.traces[1].speed_mm_s)
    enlarged = contour(result).axes[0].lines[1]
    np.testing.assert_allclose(enlarged.get_ydata(), 50 * 0.1 * np.ones(100))


@pytest.mark.slow
def test_tracking_arrives_and_a_faster_reference_leaves_more_error():
    """On lobes of half the size, which take half the time."""
    small, speeds = polar_lobes(15e-3, 5e-3, 4), (0.075, 0.15)  # [m/s]
    slow, fast = (tracked(machines(1e-3)["nominal"], small, speed) for speed in speeds)
    least = 0.9 * float(small.length) / speeds[0]  # [s] that the slow reference takes, 10 % off
    assert least < slow.score.time < np.inf and np.isfinite(fast.score.time)
    assert slow.score.rms < fast.score.rms
