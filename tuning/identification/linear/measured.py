"""The frequency response of an axis as its record shows it, whatever the order of its model.

    G = G_m S_ym / S_mm,      var G / |G|^2 = (1 - g^2) / (2 n g^2),    g^2 = |S_ym|^2 / (S_yy S_mm)

(Bendat & Piersol, Random Data, 4th ed., section 9.1) of n segments, where m is what a model G_m
answers to the command and to friction: beside it the true response is smooth, so that a window
blurs it little. Both signals are differenced, which changes no ratio and takes the drift of an
integrator away. Under feedback, what is not the command's answer pulls G towards the inverse of the
controller, relative to G by |L| (1 - g^2) / g^2 with the loop gain L: an interval is wider by that
with |L| = `FED_BACK`.
"""

import numpy as np
from scipy.signal import coherence, csd, welch
from scipy.stats import norm

from tuning.identification.estimates import CONFIDENCE
from tuning.identification.linear.evidence import Response, noise_of
from tuning.identification.linear.output_error import AxisRecord, simulated
from tuning.identification.linear.simplest import Simple

SEGMENTS = 16  # at least
LONGEST = 2.0  # [s] of a segment: lines of 0.5 Hz
FED_BACK = 2.0  # gain of the loop that recorded, where it matters: around its bandwidth
CLEAR = 0.3  # widest 95 % interval, relative, of a line that is kept
ABOVE = 3.0  # times the noise of the encoder: less is no motion
CHANCE = 1e-3  # of two signals that have nothing in common
TOGETHER = 5.0  # deviations of a mean over all lines


def measured(simple: Simple) -> Response:
    """Lines at which a record shows the response by itself; none where it shows it nowhere.

    Args:
        simple: model G_m of the record, and how much of each drag there is.
    """
    record, fit = simple.record, simple.fit
    answer = simulated(record, fit.model, drag=fit.drag).output
    rows = min(round(LONGEST / record.dt), len(answer) // SEGMENTS)
    count = len(answer) // rows
    m, y = np.diff(answer), np.diff(record.position)
    hertz, of_m = welch(m, 1 / record.dt, nperseg=rows)
    _, of_y = welch(y, 1 / record.dt, nperseg=rows)
    _, both = csd(m, y, 1 / record.dt, nperseg=rows)
    with np.errstate(divide="ignore", invalid="ignore"):
        value, part = both / of_m, np.abs(both) ** 2 / (of_m * of_y)
        left = np.maximum(1 - part, 0.0) / part
        half = float(norm.ppf((1 + CONFIDENCE) / 2)) * np.sqrt(left / (2 * count)) + FED_BACK * left
    # where only noise of the encoder moves, under feedback, both are alike: the controller answers
    floor = (
        noise_of(record.position) ** 2
        * 2
        * record.dt
        * (2 * np.sin(np.pi * hertz * record.dt)) ** 2
    )
    kept = (half < CLEAR) & (hertz > 0) & (of_y > ABOVE * floor)
    G = fit.model.response(2 * np.pi * hertz[kept])
    return Response(hertz[kept], value[kept] * G, half[kept])


def related(record: AxisRecord) -> bool:
    """Whether command and position have more in common than chance gives, at one line or at all.

    Of n segments of noise g^2 is larger than x by a chance of (1 - x)^(n - 1): minus its logarithm
    has mean 1 and deviation 1, and neighbouring lines share half of it.
    """
    rows = len(record.position) // SEGMENTS
    _, common = coherence(np.diff(record.command), np.diff(record.position), nperseg=rows)
    unlikely = -(SEGMENTS - 1) * np.log(np.maximum(1 - np.nan_to_num(common), 1e-300))
    count = len(unlikely)
    everywhere = unlikely.mean() > 1 + TOGETHER * np.sqrt(2 / count)
    return bool(unlikely.max() > np.log(count / CHANCE) or everywhere)
