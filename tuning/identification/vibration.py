"""Resonances of a machine from the vibration of its tool during a sweep.

A command of the acceleration whose frequency f rises at a constant rate, and whose amplitude grows
with f, has a power spectral density that grows with f^2. `TEST_RESONANCES` of Klipper is one. A
tool on springs, with friction towards the frame, answers with the density

    S(f) = f^2 |sum_i c_i H_i(f)|^2,     H_i = 1 / (1 - r^2 + 2j zeta_i r),     r = f / f_i
and shows it convolved with |W(f)|^2 of the window that the spectrum is taken with: a sharp peak
looks wide. The logarithm of this is fitted to the lines around the peaks by least squares, since
the scatter of a line is a share of its size. The intervals are those of the scatter that the fit
leaves. Lines that share a window are alike: N sum(w^4) / sum(w^2)^2 of them count as one.

Welch 1967; Ewins, Modal Testing, 2nd ed., section 4.3.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from scipy.signal import find_peaks, get_window, spectrogram
from scipy.stats import t, theilslopes

WINDOW, FEWEST = 2.0, 16  # length [s], and number; they overlap by three quarters
LOWEST, HIGHEST, SLOWEST = 4.0, 300.0, 400.0  # [Hz] of a sweep, and of its samples
BESIDE = 20.0, 3.0  # [Hz] from the sweep at most: at a first look, and at a second
FOLLOWING = 0.5  # of the windows, beside the sweep
MARGIN = 3.0  # [Hz] to the ends of a sweep
BELOW = 0.2  # of the lines of a sweep: the lowest, below the resonances
PROMINENCE = 4.0  # [dB] of a peak
SECOND = 0.05  # of the response of the main peak
SKIRT, SIDES = 0.25, 1.5  # lines around a peak: least part of its response, and of its frequency
CLOSE = 3  # lines on either side of a peak, that always count
DAMPING = 0.05  # to begin with
SURE, KNOWN = 0.95, 0.1  # level of the intervals; half of one of a frequency, at most


@dataclass(frozen=True)
class VibrationSpectrum:
    """Power spectral density of the acceleration in three directions, during a sweep."""

    frequency: Float[np.ndarray, " F"]  # [Hz], evenly spaced, above zero
    power: Float[np.ndarray, "F 3"]  # [(m/s^2)^2/Hz]
    swept: tuple[float, float]  # lowest and highest frequency of the sweep [Hz]
    window: Float[np.ndarray, " N"]  # as long as one over the spacing of the lines

    @property
    def inside(self) -> Bool[np.ndarray, " F"]:
        """Lines that the sweep excites."""
        return np.abs(self.frequency - np.mean(self.swept)) <= np.ptp(self.swept) / 2 - MARGIN

    @property
    def axis(self) -> int:
        """Direction that is shaken: the one that follows the command below the resonances."""
        return int(np.argmax(self.power[self.inside][: int(BELOW * self.inside.sum())].sum(axis=0)))

    @property
    def response(self) -> Float[np.ndarray, "F 3"]:
        """Power over that of the command, up to a factor."""
        return self.power / self.frequency[:, None] ** 2


@dataclass(frozen=True)
class Resonance:
    """A mode of the tool on its springs."""

    frequency: float  # undamped [Hz]
    frequency_interval: tuple[float, float]  # 95 %
    damping: float  # zeta
    damping_interval: tuple[float, float]  # 95 %
    prominence: float  # of its peak [dB]
    shares: tuple[float, float, float]  # of the directions in the power of its peak


def spectrum_of(acceleration: Float[np.ndarray, "T 3"], dt: float) -> VibrationSpectrum:
    """Welch's spectrum of a sweep, and the frequencies that it runs through.

    Args:
        acceleration: of the tool (T, 3) [m/s^2]; gravity does not matter.
        dt: sample period [s].

    Raises:
        ValueError: the samples are too slow or too few, or no sweep is seen.
    """
    length, least = round(WINDOW / dt), WINDOW * (3 + FEWEST) / 4
    if dt > 1 / SLOWEST:
        raise ValueError(f"{1 / dt:.3g} samples a second are too slow: record {SLOWEST:g} at least")
    if dt * len(acceleration) < least:
        raise ValueError(
            f"lasts {dt * len(acceleration):.3g} s, and a sweep {least:g} s at least: record "
            "TEST_RESONANCES from begin to end"
        )
    frequency, time, power = spectrogram(
        acceleration, 1 / dt, "hann", length, length - length // 4, detrend="constant", axis=0
    )
    kept = (frequency >= LOWEST) & (frequency <= HIGHEST)
    frequency, power = frequency[kept], power[kept]
    loud = power[:, int(np.argmax(power.sum(axis=(0, 2))))]
    # The sweep is where a line is loud, and louder than on average: no harmonic, no ringing
    at = frequency[np.argmax(loud**2 / loud.mean(axis=-1, keepdims=True), axis=0)]
    on = np.full(len(time), True)
    for beside in BESIDE:
        slope, start, *_ = theilslopes(at[on], time[on])
        line = start + slope * time
        on = np.abs(at - line) <= beside
        if slope <= 0 or on.mean() < FOLLOWING:
            size = np.sqrt(np.mean(np.var(acceleration, axis=0)))
            raise ValueError(
                f"no sweep from low to high frequencies shakes it (RMS {size:.2g} m/s^2): record "
                "TEST_RESONANCES of one axis, and nothing else"
            )
    swept = max(float(line[on][0]), LOWEST), float(line[on][-1])
    return VibrationSpectrum(frequency, power.mean(axis=-1), swept, get_window("hann", length))


def resonances(spectrum: VibrationSpectrum) -> list[Resonance]:
    """The main resonance of the shaken direction, and a second one where it is clear.

    Raises:
        ValueError: no peak stands out, or the highest is not of one mode or two.
    """
    f, inside = spectrum.frequency, np.flatnonzero(spectrum.inside)
    response = np.maximum(spectrum.response[:, spectrum.axis], np.finfo(float).tiny)
    peaks, found = find_peaks(10 * np.log10(response[inside]), prominence=PROMINENCE)
    if not peaks.size:
        raise ValueError(
            f"no peak stands out by {PROMINENCE:g} dB between {spectrum.swept[0]:.3g} and "
            f"{spectrum.swept[1]:.4g} Hz: no shaper is needed below; sweep further to look above"
        )
    prominences = dict(zip(inside[peaks].tolist(), found["prominences"].tolist(), strict=True))
    at = sorted(prominences, key=lambda k: -response[k])[:2]
    at = [k for k in at if response[k] >= SECOND * response[at[0]]]
    modes = _fitted(spectrum, at) or _fitted(spectrum, at[:1])
    if not modes:
        raise ValueError(
            f"the peak at {f[at[0]]:.3g} Hz has not the shape of one resonance or two: tighten "
            "what is loose and record again, or take a shaper for a wide band, as ei"
        )
    shares = spectrum.power / spectrum.power.sum(axis=1, keepdims=True)
    return [
        Resonance(*mode, prominences[k], (*shares[k].tolist(),))
        for mode, k in zip(modes, at, strict=False)
    ]


def _fitted(spectrum: VibrationSpectrum, at: list[int]) -> list[tuple]:
    """Frequency and damping with intervals, of modes that peak at these lines; none if one fails."""
    f, response = spectrum.frequency, spectrum.response[:, spectrum.axis]
    skirts = [_skirt(f, np.where(spectrum.inside, response, 0), k) for k in at]
    lines = np.any(skirts, axis=0)
    measured, (beside, shares) = np.log(spectrum.power[lines, spectrum.axis]), _leakage(spectrum)
    sizes = 2 * DAMPING * np.sqrt(response[at])

    def misses(parameters: np.ndarray) -> np.ndarray:
        hertz, zeta, size = parameters.reshape(3, -1)
        shown = f[lines, None] + beside
        r = shown[..., None] / np.exp(hertz)
        value = np.sum(sizes * size / (1 - r**2 + 2j * np.exp(zeta) * r), axis=-1)
        return np.log(np.abs(shown * value) ** 2 @ shares) - measured

    begin = [*np.log(f[at]), *[np.log(DAMPING)] * len(at)]
    signs = [[1.0], [1.0, 1.0], [1.0, -1.0]]  # a second mode helps the first, or is against it
    tried = [least_squares(misses, [*begin, *one]) for one in signs if len(one) == len(at)]
    fit = min(tried, key=lambda one: one.cost)
    w = spectrum.window
    alike = len(w) * np.sum(w**4) / np.sum(w**2) ** 2
    freedom = max(len(measured) / alike - len(fit.x), 1.0)
    spread = np.sqrt(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)) * 2 * fit.cost / freedom)
    half = np.multiply.outer([-1, 0, 1], t.ppf((1 + SURE) / 2, freedom) * spread)
    low, value, high = np.exp((fit.x + half).reshape(3, 3, -1)[:, :2])
    seen = [f[skirt][0] <= one <= f[skirt][-1] for one, skirt in zip(value[0], skirts, strict=True)]
    if not all(seen) or np.any(high[0] > (1 + KNOWN) * value[0]):
        return []
    each = zip(value.T.tolist(), low.T.tolist(), high.T.tolist(), strict=True)
    return [(v[0], (a[0], b[0]), v[1], (a[1], b[1])) for v, a, b in each]


def _skirt(f: np.ndarray, response: np.ndarray, peak: int) -> Bool[np.ndarray, " F"]:
    """Lines around a peak without a gap, down to the least part of its response."""
    kept = (response >= SKIRT * response[peak]) & (np.abs(np.log(f / f[peak])) <= np.log(SIDES))
    kept |= (np.abs(np.arange(len(f)) - peak) <= CLOSE) & (response > 0)
    part = np.cumsum(~kept)
    return kept & (part == part[peak])


def _leakage(spectrum: VibrationSpectrum) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies around a line [Hz] that its window lets through, and their shares."""
    bins, N = np.linspace(-2.2, 2.2, 45), len(spectrum.window)
    passed = np.abs(np.exp(-2j * np.pi * np.outer(bins, np.arange(N)) / N) @ spectrum.window) ** 2
    return bins * (spectrum.frequency[1] - spectrum.frequency[0]), passed / passed.sum()
