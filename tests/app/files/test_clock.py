import numpy as np
import pytest

from jcontour.app.files.clock import longest_even_part, resampled

TIME = 2.0 + 0.004 * np.arange(50)


def test_the_period_is_the_mean_step_of_a_rounded_clock():
    third = np.round(np.arange(3001) / 3000, 6)
    part = longest_even_part(third)
    assert (
        part.dt == pytest.approx(1 / 3000, rel=1e-9)
        and part.rows == slice(0, 3001)
        and part.words == ""
    )


def test_the_longest_part_and_what_is_said_of_the_rest():
    """Ten samples, then a gap, thirty samples, then the clock begins again."""
    time = np.concatenate([TIME[:10], TIME[15:45], TIME[:5]])
    part = longest_even_part(time)
    assert part.rows == slice(10, 40) and part.dt == pytest.approx(0.004)
    assert part.words.startswith("time: 1 gaps and 1 restarts of the clock, the first after 2.036")
    assert part.words.endswith("2.06 s to 2.176 s")


def test_many_gaps_are_counted_and_the_longest_part_is_named():
    """Six parts of sixty samples, one of seventy."""
    time = np.concatenate([1.0 * k + 0.004 * np.arange(70 if k == 2 else 60) for k in range(7)])
    with pytest.raises(ValueError, match="are 6 such places, .*, 2 s to 2.276 s, has 70 of 430"):
        longest_even_part(time)


def test_a_long_part_is_used_however_many_gaps_a_record_has():
    """Eight parts of two seconds at 2 kHz, one of three."""
    parts = (4.0 * k + 5e-4 * np.arange(6000 if k == 5 else 4000) for k in range(9))
    part = longest_even_part(np.concatenate(list(parts)))
    assert part.rows == slice(20_000, 26_000) and part.dt == pytest.approx(5e-4)
    assert "8 gaps" in part.words and "20 s to 22.9995 s" in part.words


def test_stamps_that_jitter_become_even_ones():
    """A line stays a line; by a tenth of a sample from one to the next."""
    jittered = np.cumsum(0.004 * np.where(np.arange(50) % 2, 0.9, 1.1))
    part = longest_even_part(jittered)
    assert part.rows == slice(0, 50) and "by up to 10 %" in part.words
    even = resampled(jittered, part.dt, np.stack([jittered, 1 - jittered], axis=1))
    assert np.allclose(even[:, 0], jittered[0] + part.dt * np.arange(50), atol=1e-12)
    assert np.allclose(even[:, 1], 1 - even[:, 0])


@pytest.mark.parametrize(
    ("time", "says"),
    [
        (TIME[:2], "needs at least three samples, has 2"),
        (TIME[::-1], "has to grow"),
        (np.zeros(9), "has to grow"),
        (np.full(9, np.nan), "has to grow"),
        (np.cumsum(0.004 * np.where(np.arange(50) % 2, 0.3, 2.0)), "not evenly spaced"),
    ],
)
def test_clocks_that_cannot_be_used(time, says):
    with pytest.raises(ValueError, match=says):
        longest_even_part(time)
