"""The shifted reference of a learned part, and what is said of it."""

import numpy as np
import pytest

from jcontour.app.files.results.verdict import exceeded
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.runs.loops.learned_reference import shifted, stored_lap
from jcontour.app.runs.loops.learning import BestLap
from jcontour.motion.references import from_samples

DT, NONE = 1e-3, MachineLimits()


def test_a_shift_is_added_and_its_speed_and_acceleration_are_those_of_a_parabola():
    """x = 2 t^2 and a constant shift: 4 m/s^2, and 4 t halfway between the last two samples."""
    time = DT * np.arange(101)
    place = np.column_stack([2 * time**2, np.zeros(101)])
    beyond = np.vstack([place, place[-1:] + [1e-3, 0.0]])  # the preview is left out
    reference = from_samples(beyond, np.tile([1.0, 0.0], (102, 1)), DT, 1)
    best = BestLap(3, 2e-6, np.full((101, 2), [-5e-6, 1e-6]))
    position = shifted(reference, best)
    np.testing.assert_allclose(position, place + [-5e-6, 1e-6], atol=1e-15)
    found = stored_lap(position, DT, best, MachineLimits(speed=np.full(2, 0.5)), "XY")
    assert found is not None and found.lap == 3
    assert found.error_um == pytest.approx(2.0) and found.largest_um == pytest.approx(5.0)
    assert found.first_um == pytest.approx(26**0.5) and all(one.kept for one in found.limits)
    tight = MachineLimits(speed=np.full(2, 0.3), acceleration=np.array([5.0, 1.0]))
    late = stored_lap(position, DT, best, tight, "XY")
    assert late is not None and exceeded(late.limits) == [
        "speed of X that the reference asks for EXCEEDS its limit: 0.398 of 0.3 m/s"
    ]
    assert found.speed == pytest.approx(4 * 0.0995) and found.acceleration == pytest.approx(4.0)


def test_nothing_is_stored_where_the_first_lap_is_the_best():
    assert stored_lap(np.zeros((4, 2)), DT, BestLap(1, 1e-6, np.zeros((4, 2))), NONE, "XY") is None
