"""Resonances of a machine from the vibration of its tool during a sweep.

A command of the acceleration whose frequency f rises at a constant rate, and whose amplitude grows
with f, has a power spectral density that grows with f^2. `TEST_RESONANCES` of Klipper is one. A
tool on springs, with friction towards the frame, answers with the density

    S(f) = f^2 |sum_i c_i H_i(f)|^2,     H_i = 1 / (1 - r^2 + 2j zeta_i r),     r = f / f_i
and shows it convolved with |W(f)|^2 of the window that the spectrum is taken with: a sharp peak
looks wide. The logarithm of this is fitted to the lines around the peaks by least squares, since
the scatter of a line is a share of its size. The intervals are those of the scatter that the fit
leaves. Lines that share a window are alike: N sum(w^4) / sum(w^2)^2 of them count as one.

Welch 1967; Ewins, Modal Testing, 2nd ed., section 4.3. The window is that of Klipper: Kaiser's, of
W = sinh(sqrt(beta^2 - (pi b)^2)) / sqrt(beta^2 - (pi b)^2) at b lines beside its own.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.signal import find_peaks, spectrogram
from scipy.stats import t, theilslopes

SECONDS, FEWEST, BETA = 2.0, 16, 6.0  # of a window, their number, and beta of Kaiser
SLOWEST, LOWEST, MARGIN = 400.0, 4.0, 3.0  # [Hz] of samples and of a sweep; to the ends of a sweep
BESIDE = 20.0, 3.0  # [Hz] from the sweep, at a first and at a second look
PROMINENCE, SECOND = 4.0, -13.0  # [dB] of a peak, and of the second one over the main one
SKIRT, SIDES, CLOSE = 0.25, 1.5, 3  # lines of a peak: response, frequency; those that always count
ALIKE = 1.96  # lines that count as one
DAMPING, SURE, KNOWN = 0.05, 0.95, 0.1  # to begin with; level of intervals; a frequency's, at most


@dataclass(frozen=True)
class Vibration:
    """Response of a tool in three directions to the command of its acceleration, during a sweep."""

    frequency: Float[np.ndarray, " F"]  # [Hz], evenly spaced by one over the length of the window
    power: Float[np.ndarray, "F 3"]  # of the acceleration over that of the command, up to a factor

    @property
    def axis(self) -> int:
        """Direction that is shaken: the one that follows the command below the resonances."""
        return int(np.argmax(self.power[: len(self.power) // 5].sum(axis=0)))


@dataclass(frozen=True)
class Resonance:
    """A mode of the tool on its springs."""

    frequency: tuple[float, float, float]  # undamped [Hz], between the ends of its 95 % interval
    damping: tuple[float, float, float]  # zeta, likewise
    shares: tuple[float, float, float]  # of the directions in the power of its peak


def vibration_of(acceleration: Float[np.ndarray, "T 3"], dt: float) -> Vibration:
    """Response by Welch's method, at the frequencies that a sweep runs through.

    Args:
        acceleration: of the tool (T, 3) [m/s^2]; gravity does not matter.
        dt: sample period [s].

    Raises:
        ValueError: the samples are too slow or too few, or no sweep is seen.
    """
    N, least = round(SECONDS / dt), SECONDS * (3 + FEWEST) / 4
    if dt > 1 / SLOWEST or dt * len(acceleration) < least:
        raise ValueError(f"a sweep needs {SLOWEST:g} samples a second, and {least:g} s of them")
    f, time, power = spectrogram(acceleration, 1 / dt, ("kaiser", BETA), N, N - N // 4, axis=0)
    f, power = f[f >= LOWEST], power[f >= LOWEST]
    loud = power[:, int(np.argmax(power.sum(axis=(0, 2))))]
    # The sweep is where a line is loud, and louder than on average: no harmonic, no ringing
    at = line = f[np.argmax(loud**2 / loud.mean(axis=-1, keepdims=True), axis=0)]
    on = np.full(len(at), True)
    for beside in BESIDE:
        line = np.polyval(np.array(theilslopes(at[on], time[on]))[:2], time)
        on = np.abs(at - line) <= beside
        if on.mean() < 0.5 or line[on][-1] - line[on][0] < 5 * MARGIN:
            raise ValueError("nothing sweeps from low to high; record TEST_RESONANCES of one axis")
    swept = (f >= line[on][0] + MARGIN) & (f <= line[on][-1] - MARGIN)
    return Vibration(f[swept], power.mean(axis=-1)[swept] / f[swept, None] ** 2)


def resonances(vibration: Vibration) -> list[Resonance]:
    """The main resonance of the shaken direction, and a second one where it is clear.

    Raises:
        ValueError: no peak stands out, or the highest is not of one mode or two.
    """
    f, response = vibration.frequency, vibration.power[:, vibration.axis]
    decibels = 10 * np.log10(response / response.max())
    peaks, _ = find_peaks(decibels, height=SECOND, prominence=PROMINENCE)
    if not peaks.size:
        raise ValueError(f"no peak of {PROMINENCE:g} dB to {f[-1]:.3g} Hz: sweep on (FREQ_END)")
    at = sorted(peaks.tolist(), key=lambda k: -response[k])[:2]
    found = _fitted(vibration, at) or _fitted(vibration, at[:1])
    if not found:
        said = "is of no one or two resonances: tighten what is loose, or take a wide shaper as ei"
        raise ValueError(f"the peak at {f[at[0]]:.3g} Hz {said}")
    return found


def _fitted(vibration: Vibration, at: list[int]) -> list[Resonance]:
    """Modes that peak at these lines; none if the frequency of one is not known."""
    f, response = vibration.frequency, vibration.power[:, vibration.axis]
    lines = np.any([_skirt(f, response, k) for k in at], axis=0)
    measured, sizes = np.log(response[lines]), 2 * DAMPING * np.sqrt(response[at])
    bins = np.linspace(-2.2, 2.2, 45)  # beside a line, between the zeros of the window
    passed = np.abs(np.sinc(np.emath.sqrt(bins**2 - (BETA / np.pi) ** 2))) ** 2
    shown = f[lines, None] + bins * (f[1] - f[0])

    def misses(parameters: np.ndarray) -> np.ndarray:
        hertz, zeta, size = parameters.reshape(3, -1)
        r = shown[..., None] / np.exp(hertz)
        value = np.sum(sizes * size / (1 - r**2 + 2j * np.exp(zeta) * r), axis=-1)
        density = np.abs(shown * value) ** 2 @ passed / passed.sum()
        return np.log(density / f[lines] ** 2) - measured

    fit = least_squares(misses, [*np.log(f[at]), *[np.log(DAMPING)] * len(at), *[1.0] * len(at)])
    freedom = max(len(measured) / ALIKE - len(fit.x), 1)
    spread = np.sqrt(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)) * 2 * fit.cost / freedom)
    half = np.outer([0, -1, 1], t.ppf((1 + SURE) / 2, freedom) * spread)
    hertz, zeta = np.exp((fit.x + half).reshape(3, 3, -1)[:, :2]).transpose(1, 2, 0).tolist()
    if any(most > (1 + KNOWN) * value for value, _, most in hertz):
        return []
    shares = (vibration.power[at].T / vibration.power[at].sum(axis=1)).T.tolist()
    return [Resonance(*map(tuple, one)) for one in zip(hertz, zeta, shares, strict=True)]


def _skirt(f: np.ndarray, response: np.ndarray, peak: int) -> np.ndarray:
    """Lines around a peak without a gap, down to the least part of its response."""
    far = (response < SKIRT * response[peak]) | (np.abs(np.log(f / f[peak])) > np.log(SIDES))
    part = np.cumsum(far & (np.abs(np.arange(len(f)) - peak) > CLOSE))
    return part == part[peak]
