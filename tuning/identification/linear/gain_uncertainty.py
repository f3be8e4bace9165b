"""How far the gain of an axis may be off: one number for all frequencies."""

import numpy as np

from tuning.identification.linear import evidence
from tuning.identification.linear.output_error import AxisFit, AxisRecord, fitted, structure_of

LEAST_GAIN = 0.02  # uncertainty of a gain: no drive repeats better from day to day
UNKNOWN_GAIN = 0.99  # uncertainty of a gain that stands for any


def gain_uncertainty(
    record: AxisRecord, fit: AxisFit, response: evidence.Response, band: tuple[float, float]
) -> tuple[float, str]:
    """Relative uncertainty: what the intervals say, and what two halves of the record disagree.

    With what it comes from.

    Args:
        record: that was fitted.
        fit: model on all of it.
        response: with the intervals of one number for all frequencies.
        band: where the response is known to 10 % [Hz].
    """
    low, high = band
    if not np.isfinite(high):
        return UNKNOWN_GAIN, "the response is nowhere known to 10 %"
    inner = (response.frequency >= low) & (response.frequency <= max(high / 2, low))
    width = float(response.half_width[inner].max())
    widest = response.frequency[inner][int(np.argmax(response.half_width[inner]))]
    # parts of as many samples that are fitted
    middle = int(np.median(fit.rows)) if record.pieces else len(record.position) // 2
    halves = []
    for part in (record.part(0, middle), record.part(middle, len(record.position))):
        try:
            half = fitted(part, structure_of(fit.model), fit.filter, fit.model, drag=fit.drag)
        except (ValueError, np.linalg.LinAlgError):
            continue
        common = halves[0].frequency if halves else None
        halves.append(evidence.response_of(half, evidence.estimate_of(half), common))
    apart = evidence.halves_apart(halves[0], halves[1], high / 2) if len(halves) == 2 else 0.0
    found = [
        (width, f"the interval of the response at {widest:.3g} Hz"),
        (apart, "the two halves of the record by themselves"),
        (LEAST_GAIN, "what drives repeat to"),
    ]
    value, words = max(found, key=lambda one: one[0])
    return min(value, UNKNOWN_GAIN), words
