"""Rests in a motion, against the integral of a clock that stands still in them."""

import numpy as np
import pytest

from jcontour.motion.feed_laws import NEVER, Rests, rest_of_pieces


def test_time_stands_still_in_rests():
    rests = Rests(np.array([0.0, 1.0, 1.0, 3.0]), np.array([0.5, 0.25, 0.0, 2.0]))
    step = 1e-3
    time = np.arange(0.0, 8.0, step)
    passed, clock = [], 0.0
    left = list(zip(rests.begin, rests.lasting, strict=True))
    for _ in time:
        passed.append(clock)
        while left and clock >= left[0][0] - 1e-9 and left[0][1] <= 1e-9:
            left.pop(0)
        if left and clock >= left[0][0] - 1e-9:
            left[0] = left[0][0], left[0][1] - step
        else:
            clock += step
    np.testing.assert_allclose(rests.moving(time), passed, atol=1e-9)
    assert rests.total == 2.75


def test_without_rests_time_is_the_same():
    time = np.linspace(0.0, 3.0, 7)
    np.testing.assert_array_equal(NEVER.moving(time), time)


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        (np.zeros(3), r"needs shape \(2,\), received \(3,\)"),
        (np.array([np.nan, -1.0]), "not below zero, received -1.0"),
        (np.array([np.inf, 1.0]), "finite"),
    ],
)
def test_bad_rests_are_refused(rest, message):
    with pytest.raises(ValueError, match=f"rest: .*{message}"):
        rest_of_pieces(rest, 2)
    assert np.isnan(rest_of_pieces(None, 2)).all()
