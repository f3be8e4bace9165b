"""Harmonics of cogging: the spectrum over position of the force that the other terms leave over."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

BINS = 1024  # over the travel
PADDED = 16  # the spectrum is sampled this many times as densely as the travel resolves
PROMINENT = 6.0  # times the median line of the spectrum: what counts as a peak
MOST_HARMONICS = 8
# of travel: below it neighbouring harmonics, and the main lobe at zero, are one peak of the
# windowed spectrum
LEAST_PITCHES = 2.5


class Spectrum(NamedTuple):
    """Amplitude [N] of every line over its wavenumber [1/m], (F,) each, and the travel [m]."""

    wavenumber: Float[np.ndarray, " F"]
    amplitude: Float[np.ndarray, " F"]
    travel: float


class Harmonics(NamedTuple):
    """Pole pitch [m] and order of the highest of its harmonics that stand out.

    Where none does and no pitch was given, the pitch is the travel.
    """

    pole_pitch: float
    highest: int


def spectrum(position: Float[np.ndarray, " N"], force: Float[np.ndarray, " N"]) -> Spectrum:
    """Spectrum over position of scattered values of the force.

    The values are averaged in bins, under a Hann window; the amplitudes are those of sines.
    """
    edges = np.linspace(position.min(), position.max(), BINS + 1)
    filled, _ = np.histogram(position, edges)
    sums, _ = np.histogram(position, edges, weights=force)
    centres, there = (edges[1:] + edges[:-1]) / 2, filled > 0
    even = np.interp(centres, centres[there], sums[there] / filled[there])
    window = np.hanning(BINS)
    lines = (
        np.abs(np.fft.rfft(window * (even - np.average(even, weights=window)), PADDED * BINS))
        * 2
        / window.sum()
    )
    travel = float(np.ptp(position))
    return Spectrum(np.fft.rfftfreq(PADDED * BINS, travel / BINS), lines, travel)


def harmonics(found: Spectrum, pole_pitch: float | None = None) -> Harmonics:
    """The largest peak as the fundamental, unless the pitch is given, and its multiples.

    Raises:
        ValueError: the travel is too short for the harmonics of the given pitch.
    """
    resolved = found.wavenumber >= LEAST_PITCHES / found.travel
    floor = PROMINENT * np.median(
        found.amplitude[resolved & (found.wavenumber < BINS / 4 / found.travel)]
    )
    if pole_pitch is None:
        peaks = find_peaks(found.amplitude, height=floor)[0]
        peaks = peaks[resolved[peaks]]
        if not peaks.size:
            return Harmonics(found.travel, 0)
        highest = int(peaks[np.argmax(found.amplitude[peaks])])
        pole_pitch = 1 / _top(found, highest)
    if found.travel < LEAST_PITCHES * pole_pitch:
        raise ValueError(
            f"pole_pitch: the slow passes travel {found.travel:.3g} m, "
            f"{found.travel / pole_pitch:.2g} pole pitches of {pole_pitch:.3g} m; "
            f"telling the harmonics of cogging apart needs {LEAST_PITCHES}"
        )
    near = gaussian_filter1d(found.amplitude, PADDED / 4)
    loud = [
        np.interp(j / pole_pitch, found.wavenumber, near) > floor
        for j in range(1, MOST_HARMONICS + 1)
    ]
    return Harmonics(pole_pitch, max((j for j, heard in enumerate(loud, 1) if heard), default=0))


def _top(found: Spectrum, k: int) -> float:
    """Wavenumber of the top of the parabola through a peak and its neighbours."""
    a, b, c = found.amplitude[k - 1 : k + 2]
    return found.wavenumber[k] + (found.wavenumber[1] - found.wavenumber[0]) * (a - c) / 2 / (
        a - 2 * b + c
    )
