"""Noise of an encoder beside its rounding, by what a model leaves of a record.

That is noise w on the command, behind the model, and noise e on the position, both white:

    S_r(f) = |G(f)|^2 S_w + S_e,      S_w, S_e >= 0

e.g. Ljung, System Identification (1999), section 4.2. G falls with the frequency, so the two are
told apart by their shape. The noise of the encoder is what e has more than rounding, whose
variance is a twelfth of a squared count.
"""

import numpy as np
from scipy.optimize import nnls
from scipy.signal import welch

from tuning.identification.linear.output_error import AxisFit

SPECTRUM = 1024  # samples of one spectrum of many
LOWEST = 0.05  # of the sampling rate: below, whatever a model lacks is largest
ROUNDS = 10
MORE = 0.2  # of the variance of rounding: a smaller part of it may be chance
SEEN = 0.5  # of the spectrum at its highest frequency: less hides behind what comes to the command


def encoder_noise(fit: AxisFit, resolution: float) -> float:
    """Standard deviation of the noise of an encoder beside its rounding [m]; 0 where none is sure.

    Args:
        fit: model of the axis on its record.
        resolution: length of a count [m].
    """
    rounding = resolution**2 / 12
    more = _white(fit) - rounding
    return float(np.sqrt(more)) if more > MORE * rounding else 0.0


def _white(fit: AxisFit) -> float:
    """Variance of e [m^2], by least squares over the spectrum, relative to what is fitted.

    0 where the noise on the command hides it.
    """
    dt = fit.model.dt
    inside = fit.residual != 0  # while commands from before the record act there is none
    if not inside.any():
        return 0.0
    hertz, spectrum = welch(fit.residual, 1 / dt, nperseg=min(SPECTRUM, len(inside)))
    high = (hertz > LOWEST / dt) & (hertz < 0.5 / dt)
    spectrum = spectrum[high] / np.mean(inside)
    answer = np.abs(fit.model.response(2 * np.pi * hertz[high])) ** 2
    shapes = np.stack([answer / answer.max(), np.ones(high.sum())], axis=1)
    fitted = np.full(high.sum(), spectrum.mean())
    found = np.zeros(2)
    for _ in range(ROUNDS):
        found, _ = nnls(shapes / fitted[:, None], spectrum / fitted)
        fitted = np.maximum(shapes @ found, 1e-6 * spectrum.mean())
    return float(found[1]) / (2 * dt) if found[1] > SEEN * fitted[-1] else 0.0
