"""The clock of written moves keeps to the times that were asked for."""

import numpy as np

from jcontour.app.files.written_moves import LEAST_FEED, clock, steps


def test_rounded_feeds_do_not_drift():
    """Ten thousand moves of an odd length: alone, each feed of six digits is off by up to 5e-6."""
    places = np.cumsum(np.full((10_001, 1), 1.0 / 3.0), axis=0)
    lasting = np.full(10_000, 0.0137)
    written = steps(places, lasting)
    times, at = clock(places, written)
    np.testing.assert_allclose(times[1:], np.cumsum(lasting), atol=2e-7)
    np.testing.assert_array_equal(at, places)
    assert {len(f"{step.word:.15g}".replace(".", "")) for step in written} <= {5, 6}


def test_a_move_too_slow_for_a_program_waits_behind_its_end():
    """1 nm in a second is 60 nm/min; the program may say 60 um/min at least."""
    places = np.array([[0.0], [1e-6], [1.0]])
    (first, dwell, last) = steps(places, np.array([1.0, 0.1]))
    assert first.word == LEAST_FEED and dwell.end is None
    np.testing.assert_allclose(60 * 1e-6 / first.word + dwell.word, 1.0, rtol=1e-6)
    np.testing.assert_allclose(last.word, 600.0, rtol=1e-5)


def test_rests_in_a_row_are_one_dwell():
    places = np.array([[1.0], [1.0], [1.0], [2.0], [2.0]])
    written = steps(places, np.array([0.2, 0.3, 0.1, 1234.5678912]))
    assert [step.end for step in written] == [None, 3, None]
    times, at = clock(places, written)
    np.testing.assert_allclose(times, [0, 0.5, 0.6, 1235.1678912], atol=1e-5)
    np.testing.assert_array_equal(at, [[1], [1], [2], [2]])
