import numpy as np

from tuning.identification.linear.moving import moving


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
