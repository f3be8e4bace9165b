import numpy as np
import pytest

from tuning.identification.linear.moving import moving, quick


def test_turns_and_rests_are_in_no_piece():
    """To 10 mm at 20 mm/s, a rest, and back; counts of 1 um: 20 of them in a sample."""
    there = 2e-5 * np.arange(500)
    y = np.concatenate([np.zeros(100), there, np.full(100, 1e-2), 1e-2 - there, np.zeros(100)])
    signs, pieces = moving(y, 1e-6)
    assert len(pieces) == 2
    for (start, end), first, sign in zip(pieces, (100, 700), (-1, 1), strict=True):
        assert first <= start <= first + 4 and first + 496 <= end <= first + 500
        assert np.all(signs[start:end] == sign)
    assert not signs[:98].any() and not signs[602:698].any() and not signs[1202:].any()


def test_a_crawl_below_the_counts_has_no_sign():
    """0.1 mm/s is 1.6 um in the widest window, of counts of 1 um."""
    assert not moving(1e-6 * np.round(0.1 * np.arange(2000)), 1e-6)[1]


def test_what_is_slow_is_in_no_quick_piece():
    """Ramps of the speed to 20 mm/s in 400 samples, and a crawl at 1 mm/s: above 2 mm/s it counts.

    By the motion over 16 samples, so that a piece may begin a few samples before or after.
    """
    up = np.linspace(0.0, 2e-5, 400)
    speed = np.concatenate([up, np.full(400, 2e-5), up[::-1], np.full(600, 1e-6)])
    y = np.cumsum(speed)
    signs, pieces = moving(y, 1e-8)
    (start, end), *more = quick(y, signs)
    assert not more and len(pieces) == 1 and pieces[0][1] > 1750
    assert start == pytest.approx(40, abs=3) and end == pytest.approx(1160, abs=3)


def test_a_record_at_rest_has_no_quick_piece():
    assert quick(np.zeros(100), np.zeros(100)) == []
