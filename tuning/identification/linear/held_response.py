"""The response of an axis, with an interval that holds each model that a record does not exclude.

A mode that the record hardly shows is sharp: between two frequencies of a coarse grid its peak is
missed. So the frequencies are close around every mode of these models. Such a fit may be without
any damping, which no machine is; a model is held with at least `LEAST_DAMPING`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tuning.identification.estimates import Estimate
from tuning.identification.linear import evidence
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.evidence import Response
from tuning.identification.linear.output_error import AxisFit

LEAST_DAMPING = 5e-3  # of a pair: half of what a stiff machine has
SHARP = 0.05  # damping below which a mode is narrower than the grid
AROUND = np.array([-8.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 8.0])  # half widths of a peak
APART = 2e-3  # relative: frequencies that lie closer together are one


def own_response(fit: AxisFit, estimate: Estimate, models: Sequence[AxisModel]) -> Response:
    """The response of a fit, also at the frequencies around the modes of other models."""
    usual = evidence.response_of(fit, estimate).frequency
    more = [around_modes(model.damped(LEAST_DAMPING)) for model in (fit.model, *models)]
    every = np.unique(np.concatenate([usual, *more]))
    every = every[(every >= usual[0]) & (every <= usual[-1])]
    apart = np.append(np.diff(every) > APART * every[:-1], True)
    return evidence.response_of(fit, estimate, every[apart])


def held_response(
    own: Response, equals: Sequence[AxisModel], others: Sequence[AxisFit]
) -> Response:
    """The response with an interval that holds models, and others with their own intervals.

    Args:
        own: at the frequencies of `own_response`.
        equals: models of other delays.
        others: fits of other structures.
    """
    held = evidence.widened(own, [model.damped(LEAST_DAMPING) for model in equals])
    for fit in others:
        damped = replace(fit, model=fit.model.damped(LEAST_DAMPING))
        beside = evidence.response_of(damped, evidence.estimate_of(fit), own.frequency)
        held = evidence.holding(held, beside)
    return held


def around_modes(model: AxisModel) -> Float[np.ndarray, " F"]:
    """Frequencies [Hz] at and around the sharp peaks of a model."""
    rates = np.log(model.poles[np.imag(model.poles) > 0]) / model.dt
    size = np.abs(rates)
    damping = -np.real(rates) / size
    sharp = damping < SHARP
    places = size[sharp, None] * (1 + damping[sharp, None] * AROUND) / (2 * np.pi)
    return places.ravel()
