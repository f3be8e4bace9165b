"""Delays that a record does not exclude, those of a model with a hidden resonance among them."""

import numpy as np

from tuning.identification.linear import evidence
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.order_search import Choice, Settled, settled
from tuning.identification.linear.output_error import AxisRecord

RESONANT = 100.0  # [Hz] up to which a drive may ring; of a slow clock what its rate allows
OF_RATE = 0.1  # of the sampling rate
STARTS = 2  # of the largest structure
PLACES = 30  # frequencies at which two models are compared


def rivals_of(
    record: AxisRecord, found: Settled, choice: Choice, most_delay: int
) -> dict[int, float]:
    """By how much other delays are less likely: in this model, and in a richer one.

    A mode that the record hardly shows is hidden in the delay of a model without it. So the delays
    of the largest structure count too, where it answers otherwise in the range of resonances.
    """
    rivals, model = dict(found.rivals), found.fit.model
    frequency = 2 * np.pi * np.geomspace(1.0, may_ring_to(model.dt), PLACES)
    own = model.response(frequency)
    for one in choice.largest[:STARTS]:
        if len(one.fit.model.denominator) <= len(model.denominator):
            break
        richer = settled(record, one.fit, most_delay)
        if np.abs(richer.fit.model.response(frequency) / own - 1).max() < evidence.SHOWN:
            continue
        behind = max(richer.less_likely(found), 0.0)
        for d, value in {richer.fit.model.delay: 0.0, **richer.rivals}.items():
            rivals[d] = min(rivals.get(d, np.inf), behind + value)
    rivals.pop(model.delay, None)
    return rivals


def lag(model: AxisModel, other: AxisModel) -> float:
    """By how much another model answers later, at most [samples]; below zero where it is sooner.

        tau(omega) = -arg(G'(omega) / G(omega)) / (omega dt)

    over the decade up to the highest resonance: there loops are closed, and below it the smallest
    error of a gain or of friction counts as many samples. A numerator may make up for a delay.
    """
    highest = may_ring_to(model.dt)
    frequency = 2 * np.pi * np.geomspace(highest / 10, highest, PLACES)
    turned = np.angle(other.response(frequency) / model.response(frequency))
    return float(np.max(-turned / (frequency * model.dt)))


def may_ring_to(dt: float) -> float:
    """Highest frequency of a resonance [Hz] that is looked for."""
    return min(RESONANT, OF_RATE / dt)
