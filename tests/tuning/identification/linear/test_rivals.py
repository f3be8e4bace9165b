from dataclasses import dataclass

import numpy as np
import pytest

from jcontour.linear.continuous_axes import position_axis, speed_axis, with_resonance
from tuning.identification.linear import rivals
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.order_search import Candidate, Choice, Settled, settled
from tuning.identification.linear.output_error import AxisFit, AxisRecord, Structure, fitted
from tuning.identification.linear.recording import RecordedAxis, recorded
from tuning.identification.linear.rivals import lag, may_ring_to, rivals_of

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


def test_the_delay_behind_a_resonance_that_slow_motion_hides():
    """60 Hz behind one sample, lines with corners: a model without it has several samples more.

    Its true delay is a rival, by the likelihoods of both models behind their noise filters.
    """
    axis = with_resonance(position_axis(0.9, 0.018, DT), 2 * np.pi * 60, 0.1)
    one = RecordedAxis(axis, "position", 0.5e-6, 0.2e-6, 1e-3, (1.2,))
    reference = 0.05 * DT * np.cumsum(np.sign(np.sin(2 * np.pi * 2.5 * DT * np.arange(ROWS))))
    record = AxisRecord(DT, *recorded(one, reference, DT, np.random.default_rng(2)))
    plain, rich = fitted(record, Structure(1, 1, 0, 3)), fitted(record, Structure(3, 3, 0, 1))
    found = settled(record, plain, 6)
    small, large = (Candidate(fit, fit.errors) for fit in (plain, rich))
    assert found.fit.model.delay > 1
    said = rivals_of(record, found, Choice(small, [small, large]), 6)
    assert said[1] == 0.0 and found.rivals.get(1, np.inf) > 0.0
    assert found.fit.model.delay not in said


@dataclass(frozen=True)
class Richer(Settled):
    """What `settled` would say of a larger structure, and by how much it is less likely."""

    behind: float = 0.0

    def less_likely(self, other):
        return self.behind


class Asked(Choice):
    """A choice whose structures are all of the largest size."""

    @property
    def largest(self):
        return self.all


def model(delay, poles, gain=1.0):
    """A fit with a pole of 0.9, and others at nought that change nothing."""
    model = AxisModel(np.append(-0.9, np.zeros(poles - 1)), np.array([0.1 * gain]), 0, delay, DT)
    nothing = np.zeros(0)
    return AxisFit(model, *[nothing] * 6, np.zeros((0, poles + 1)), np.arange(0))


@pytest.mark.parametrize(
    ("richer", "wanted"),
    [
        # 9 % off in gain adds nothing; 20 % off, its delay and its rivals count
        ([Richer(model(0, 3, 1.09), {3: 0.0}, behind=0.0)], {1: 6.0, 4: 9.0}),
        (
            [Richer(model(2, 3, 1.2), {3: 1.5, 4: 2.0}, behind=0.5)],
            {1: 6.0, 2: 0.5, 3: 2.0, 4: 2.5},
        ),
        # a likelier one is a rival without a doubt, not more than that
        ([Richer(model(1, 3, 1.2), {4: 2.0}, behind=-30.0)], {1: 0.0, 4: 2.0}),
        # smaller doubts of the model's own stay, and its own delay is no rival
        ([Richer(model(1, 3, 1.2), {0: 1.0, 4: 1.0}, behind=20.0)], {1: 6.0, 4: 9.0}),
        # another delay alone answers otherwise as well
        ([Richer(model(3, 3), {}, behind=1.0)], {1: 6.0, 3: 1.0, 4: 9.0}),
        # two starts of one structure, each with what it excludes; a third is not asked
        (
            [
                Richer(model(3, 3, 1.2), {}, behind=1.0),
                Richer(model(4, 3, 1.2), {3: 0.25}, behind=0.0),
                Richer(model(2, 3, 1.2), {}, behind=0.0),
            ],
            {1: 6.0, 3: 0.25, 4: 0.0},
        ),
        # no more poles than the model has
        ([Richer(model(3, 1, 1.2), {}, behind=0.0)], {1: 6.0, 4: 9.0}),
    ],
)
def test_what_a_richer_model_adds(richer, wanted, monkeypatch):
    """The model has no delay and two rivals; what is wanted was counted by hand."""
    found = Richer(model(0, 1), {1: 6.0, 4: 9.0}, behind=0.0)
    waiting = iter(richer)
    monkeypatch.setattr(rivals, "settled", lambda *_: next(waiting))
    best, *largest = (Candidate(one.fit, np.zeros(1)) for one in (found, *richer))
    choice = Asked(best, largest)
    record = AxisRecord(DT, np.zeros(9), np.zeros(9))
    said = rivals_of(record, found, choice, 6)
    assert said == wanted and found.rivals == {1: 6.0, 4: 9.0}


@pytest.mark.parametrize(
    ("numerator", "delay", "wanted"),
    [
        ([0.1], 2, 1.0),
        ([0.0, 0.1], 0, 0.0),  # the numerator makes up for the delay
        ([0.05, 0.05], 1, 0.5),  # a mean of two samples has the phase of half of one
        ([0.13], 1, 0.0),  # a gain turns nothing
        ([0.1], 0, -1.0),
    ],
)
def test_a_lag_is_of_the_whole_response(numerator, delay, wanted):
    one = AxisModel(np.array([-0.9]), np.array([0.1]), 1, 1, DT)
    other = AxisModel(np.array([-0.9]), np.array(numerator), 1, delay, DT)
    assert lag(one, other) == pytest.approx(wanted, abs=1e-9)


def test_a_slow_clock_rings_less_high():
    assert may_ring_to(1e-4) == may_ring_to(1e-3) == 100.0
    assert may_ring_to(0.01) == pytest.approx(10.0)
