"""Which numbers of two tuned runs can be compared."""

import pytest

from jcontour.app.files.results.run_metrics import ContourRead, MachineSummary
from jcontour.app.files.results.tuned_result import TunedContour
from jcontour.app.runs.checks.weights.comparable import (
    comparable,
    control_units,
    same_period,
    unlike_motions,
    unlike_paths,
)
from tests.app import small_runs


def tuned(*contours, unit="V", period=1e-3, name="mill"):
    machine = MachineSummary(name, unit, ("X", "Y"), "counts")
    return small_runs.tuned_result(contours=[*contours], machine=machine, sample_period=period)


def contour(name="circle", length=6.0, duration=1.0, feed_law="constant 360 mm/min"):
    read = ContourRead(1, length, duration, (-1.0, -1.0), (1.0, 1.0))
    return TunedContour(
        name=name, training=True, samples=9, metrics={}, read=read, feed_law=feed_law
    )


def test_a_path_of_another_length_or_box_is_another():
    assert unlike_paths(tuned(contour()), tuned(contour(length=6.0001))) == []
    assert unlike_paths(tuned(contour()), tuned(contour(length=6.1))) == ["circle"]
    assert unlike_paths(tuned(contour()), tuned(contour("square", length=9.0))) == []
    assert unlike_motions(tuned(contour()), tuned(contour(length=6.1, duration=2.0))) == {}


@pytest.mark.parametrize(
    ("changes", "other"),
    [
        ({}, False),
        ({"duration": 1.0015}, False),  # a sample and a half: rounded to whole samples
        ({"duration": 1.01}, True),
        ({"feed_law": "jerk-limited, 360 mm/min"}, True),
        ({"feed_law": ""}, False),  # of an older version
        ({"feed_law": "", "duration": 2.0}, True),
        ({"duration": None}, False),
    ],
)
def test_a_motion_is_its_feed_law_and_its_duration(changes, other):
    found = unlike_motions(tuned(contour()), tuned(contour(**changes)))
    assert bool(found) is other


def test_how_either_run_moves_is_told():
    found = unlike_motions(
        tuned(contour()), tuned(contour(duration=2.5, feed_law="trapezoidal, 360 mm/min"))
    )
    assert found == {"circle": ["constant 360 mm/min, 1 s", "trapezoidal, 360 mm/min, 2.5 s"]}


def test_units_decide_on_controls_and_the_sample_on_their_changes():
    mine, unit, fast = tuned(), tuned(unit="A"), tuned(period=5e-4)
    metrics = ("rms_contour_error", "rms_control", "rms_increment")
    assert [comparable(name, mine, mine) for name in metrics] == [True, True, True]
    assert [comparable(name, mine, unit) for name in metrics] == [True, False, False]
    assert [comparable(name, mine, fast) for name in metrics] == [True, True, False]
    assert same_period(1e-3, 0.001) and same_period(None, 1e-3) and not same_period(1e-3, 1.1e-3)


def test_a_unit_without_a_name_is_that_of_one_machine():
    mill, lathe = tuned(unit="control unit"), tuned(unit="control unit", name="lathe")
    assert comparable("rms_control", mill, mill)
    assert not comparable("rms_control", mill, lathe)
    assert control_units(mill, lathe) == ["control unit of mill", "control unit of lathe"]
    assert comparable("rms_control", tuned(), tuned(name="lathe"))
