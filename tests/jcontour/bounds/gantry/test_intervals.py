"""Intervals contain the results of all their numbers, and no more where it can be known."""

import numpy as np
import pytest

from jcontour.bounds.gantry.intervals import Interval


def drawn(seed, away=0.0):
    random = np.random.default_rng(seed)
    ends = np.sort(random.uniform(-4, 4, (2, 200)), axis=0) + away
    return Interval(*ends), random.uniform(*ends)


def contains(interval, values, tolerance=1e-12):
    return np.all((interval.low <= values + tolerance) & (values - tolerance <= interval.high))


def test_results_of_numbers_inside_are_inside():
    (a, x), (b, y), (c, z) = drawn(0), drawn(1), drawn(2, away=5.0)
    assert contains(a.plus(b), x + y) and contains(a.minus(), -x)
    assert contains(a.times(b), x * y) and contains(a.square(), x**2)
    assert contains(a.sine(), np.sin(x)) and contains(a.cosine(), np.cos(x))
    assert contains(c.reciprocal(), 1 / z) and np.all(a.size >= np.abs(x))


def test_they_are_as_small_as_can_be():
    x = Interval(np.array([0.1, 1.0, -1.0, 3.0]), np.array([0.2, 2.0, 0.5, 3.5]))
    dense = x.low + (x.high - x.low) * np.linspace(0, 1, 20001)[:, None]
    for found, exact in ((x.sine(), np.sin), (x.cosine(), np.cos), (x.square(), np.square)):
        assert found.low == pytest.approx(exact(dense).min(axis=0), abs=1e-8)
        assert found.high == pytest.approx(exact(dense).max(axis=0), abs=1e-8)


def test_a_division_by_what_may_be_zero_is_told():
    with pytest.raises(ValueError, match="one of them reaches zero"):
        Interval(np.array(-1.0), np.array(0.0)).reciprocal()
