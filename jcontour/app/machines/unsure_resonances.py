"""How far off a response may be where a resonance is not exactly where it is said to be.

The resonance of an axis is a factor R(s) = w^2 / (s^2 + 2 z w s + w^2). Of a true one of w' and z'

    G_true / G = R'(s) / R(s),      s = j 2 pi f

whatever the rest of the axis is.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

LESS_DAMPED = 0.5  # of the damping, at least: it is known worse than the frequency
TRIED = 21  # frequencies of the resonance within its interval
AROUND, BESIDE = 40, 12  # frequencies where it may be, and on either side
WIDE, FAR = 1.5, 10.0  # times the resonance: around, and as far as the response is told


def unsure_resonances(
    hertz: Sequence[float], damping: float, part: float, dt: float
) -> dict[str, Any]:
    """Field `uncertainty.response` of a machine file: largest |G_true / G - 1| of every axis.

    Args:
        hertz: resonance of every axis [Hz], 0 for one without; not all are 0.
        damping: of all of them; it may be half of that.
        part: by which a frequency may be higher or lower, below 1.
        dt: sample period [s].
    """
    places = np.unique(np.concatenate([places_around(one, dt) for one in hertz if one]))
    rows = [moved(one, damping, part, places) if one else np.zeros_like(places) for one in hertz]
    return {
        "hertz": [float(f"{one:.6g}") for one in places],
        "relative": [[float(f"{one:.4g}") for one in row] for row in rows],
    }


def places_around(hertz: float, dt: float) -> Float[np.ndarray, " F"]:
    """Frequencies around a resonance, up to half the sampling rate [Hz]."""
    parts = np.concatenate(
        [
            np.geomspace(1 / FAR, 1 / WIDE, BESIDE, endpoint=False),
            np.geomspace(1 / WIDE, WIDE, AROUND, endpoint=False),
            np.geomspace(WIDE, FAR, BESIDE),
        ]
    )
    found = hertz * parts
    return found[found < 0.5 / dt]


def moved(
    hertz: float, damping: float, part: float, places: Float[np.ndarray, " F"]
) -> Float[np.ndarray, " F"]:
    """Largest |R' / R - 1| of the resonances that there may be in place of the one that is said.

    Args:
        hertz: resonance that is said [Hz].
        damping: likewise; the true one may have half of it.
        part: by which its frequency may be higher or lower.
        places: frequencies [Hz].
    """
    said = _factor(hertz, damping, places)
    true = [
        _factor(hertz * shift, z, places)
        for shift in np.linspace(1 - part, 1 + part, TRIED)
        for z in (damping, LESS_DAMPED * damping)
    ]
    return np.abs(np.array(true) / said - 1).max(axis=0)


def _factor(
    hertz: float, damping: float, places: Float[np.ndarray, " F"]
) -> Complex[np.ndarray, " F"]:
    s, w = 2j * np.pi * places, 2 * np.pi * hertz
    return w**2 / (s**2 + 2 * damping * w * s + w**2)
