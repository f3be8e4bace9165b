import numpy as np
import pytest

from jcontour.linear.continuous_axes import speed_axis
from tuning.identification.linear.order_search import Candidate, Choice, settled
from tuning.identification.linear.output_error import AxisRecord, Structure, fitted
from tuning.identification.linear.recording import RecordedAxis, recorded
from tuning.identification.linear.rivals import may_ring_to, rivals_of

DT, ROWS = 1e-3, 6000


@pytest.fixture(scope="module")
def record():
    """Steps of the reference of a drive that takes a speed, without a resonance."""
    one = RecordedAxis(speed_axis(0.8, 0.015, DT), "speed", 1e-6, 0.5e-6, 1e-3, (10.0,))
    reference = np.repeat(np.random.default_rng(0).uniform(-0.01, 0.01, ROWS // 60), 60)
    return AxisRecord(DT, *recorded(one, reference, DT, np.random.default_rng(1)))


def test_a_richer_model_that_says_the_same_adds_no_delay(record):
    """Corners show the axis: three poles answer as one does up to 100 Hz."""
    plain, rich = (fitted(record, Structure(n, n + 1, 1, 1)) for n in (1, 3))
    found = settled(record, plain, 4)
    small, large = (Candidate(fit, fit.errors) for fit in (plain, rich))
    assert rivals_of(record, found, Choice(small, [small]), 4) == found.rivals
    assert rivals_of(record, found, Choice(small, [small, large]), 4) == found.rivals


def test_a_slow_clock_rings_less_high():
    assert may_ring_to(1e-4) == may_ring_to(1e-3) == 100.0
    assert may_ring_to(0.01) == pytest.approx(10.0)
