"""Noise of the encoders of motor and end effector, from the residual of a fit of the link.

White noise s_e of the end effector's encoder stays white; that of the motor's, s_m, goes through
the link and rings. Their sum has the spectrum

    s_e^2 + s_m^2 |G(j w)|^2,    G(s) = (c s + k) / (s^2 + c s + k),  k = k_s / M_e, c = c_s / M_e,
and s_e and s_m follow from the residual by Whittle's likelihood. Encoder counts are part of the
noise.
"""

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize


def encoder_noise(
    residual: Float[np.ndarray, " T"], dt: float, link: Float[np.ndarray, " 2"]
) -> Float[np.ndarray, " 2"]:
    """Standard deviations (s_m, s_e) [m] that best explain the residual.

    `link` is k_s / M_e [1/s^2] and c_s / M_e [1/s].
    """
    power = np.abs(np.fft.rfft(residual)[1:]) ** 2 / len(residual) / np.var(residual)
    passed = _passed(np.fft.rfftfreq(len(residual), dt)[1:], link)

    def surprise(logarithms):
        spectrum = np.exp(logarithms[0]) * passed + np.exp(logarithms[1])
        return np.sum(np.log(spectrum) + power / spectrum)

    variances = np.exp(
        minimize(surprise, [-1.0, -1.0], method="Nelder-Mead").x
    )  # relative to the residual's
    return np.sqrt(variances * np.var(residual))


def noise_correlation(
    noise: Float[np.ndarray, " 2"], dt: float, link: Float[np.ndarray, " 2"], rows: int
) -> Float[np.ndarray, " T"]:
    """Autocorrelation [m^2] of the residual that such noise leaves, at lags of 0, 1, ... rows."""
    passed = _passed(np.fft.rfftfreq(2 * rows, dt), link)
    return np.fft.irfft(noise[0] ** 2 * passed + noise[1] ** 2)[:rows]


def _passed(
    hertz: Float[np.ndarray, " F"], link: Float[np.ndarray, " 2"]
) -> Float[np.ndarray, " F"]:
    """|G|^2 from the motor to the end effector."""
    s = 2j * np.pi * hertz
    carried = link[1] * s + link[0]
    return np.abs(carried / (s**2 + carried)) ** 2
