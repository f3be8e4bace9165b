"""What is not known about a machine: its input gains, further delay, its frequency response.

Stated under `uncertainty` of a machine file, or as `UNCERTAINTY` in a Python file with a plant.
Where nothing is stated the usual is assumed, as `jcontour machine` writes it.
"""

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Array, Complex, Float

from jcontour._arrays import placed

if TYPE_CHECKING:  # the analysis of loops takes a while to import
    from jcontour.analysis.uncertain_loops import ResponseUncertainty

FRICTION_KNOWN_TO = 0.1  # it changes with load and temperature, and from day to day
GAIN_KNOWN_TO = {  # a data sheet is seldom better; a position drive follows its own encoder
    "speed": 0.1,
    "position": 0.0,
    "force": 0.1,
}
LATE = 1  # sample: what a drive's bus takes
IN_FILE, IN_PYTHON = '"uncertainty":', "UNCERTAINTY ="  # how a file states it


class Uncertainty(NamedTuple):
    """What is not known about a machine."""

    gain: float  # relative uncertainty of the input gains
    delay: int  # most samples of delay that the model does not know
    # how far off the frequency response may be beside these; None where nothing is said
    response: "ResponseUncertainty | None" = None
    assumed: str = ""  # how a file would state it; empty where it does


class GainMember(NamedTuple):
    """A plant of the family: name, input gains (p,) and extra delay [samples]."""

    name: str
    gains: np.ndarray
    late: float


def assumed(name: str, gain: float, delay: int, statement: str) -> str:
    """A line of what is assumed where nothing is stated, and of how to state it."""
    gains = f"gains {100 * gain:g} % off both ways and " if gain else ""
    samples = "a sample" if delay == 1 else f"{delay} samples"
    return (
        f"{name}: its file does not say how well it is known, so it may have {gains}"
        f'{samples} of delay more; {statement} {{"gain": 0.05, "delay": 2}} in it says otherwise'
    )


def family_members(inputs: int, unsure: Uncertainty) -> list[GainMember]:
    """The nominal plant, gains off both ways, and every whole sample of delay."""
    gain, delay = unsure.gain, unsure.delay
    sign = np.where(np.arange(inputs) % 2 == 0, 1.0, -1.0)
    unchanged = 1 + 0 * sign
    members = [GainMember("nominal", unchanged, 0)]
    for side in (1, -1) if gain > 0 else ():
        gains = 1 + side * gain * sign
        members.append(GainMember(_gains(gains), gains, 0))
    members += [GainMember(_late(late), unchanged, late) for late in range(1, delay + 1)]
    return members


def _gains(gains: Float[np.ndarray, " p"]) -> str:
    return "gains " + ", ".join(f"{one:.3g}" for one in gains)


def _late(samples: float) -> str:
    return f"{samples:.3g} {'sample' if samples == 1 else 'samples'} late"


def random_members(count: int, seed: int, inputs: int, unsure: Uncertainty) -> list[GainMember]:
    """Plants with gains and delays drawn evenly from their intervals, then their corners.

    A delay has parts of a sample. There are none where both are known.
    """
    gain, delay = unsure.gain, unsure.delay
    if gain == delay == 0:
        return []
    random = np.random.default_rng(seed)
    gains = 1 + gain * random.uniform(-1, 1, (count, inputs))
    delays = random.uniform(0, delay, count)
    low, high = [1 - gain] * inputs + [0.0], [1 + gain] * inputs + [float(delay)]
    drawn = with_corners(np.column_stack([gains, delays]), low, high)
    return [
        GainMember(f"{_gains(gains)}, {_late(late)}", gains, float(late))
        for gains, late in zip(drawn[:, :-1], drawn[:, -1], strict=True)
    ]


def with_corners(
    drawn: Float[np.ndarray, "n d"], low: Sequence[float], high: Sequence[float]
) -> Float[np.ndarray, "n d"]:
    """Draws from intervals, the last of them replaced by the corners where there are more draws.

    >>> with_corners(np.full((5, 2), 0.5), [0.0, 0.0], [1.0, 2.0])[1:].tolist()
    [[0.0, 0.0], [0.0, 2.0], [1.0, 0.0], [1.0, 2.0]]
    """
    corners = np.array(list(product(*zip(low, high, strict=True))))
    kept = len(drawn) - len(corners)
    return drawn if kept < 1 else np.concatenate([drawn[:kept], corners])


LESS_DAMPED = 0.5  # of the damping, at least: it is known worse than the frequency
TRIED = 21  # frequencies of the resonance within its interval
AROUND, BESIDE = 40, 12  # frequencies where it may be, and on either side
WIDE, FAR = 1.5, 10.0  # times the resonance: around, and as far as the response is stated


def unsure_resonances(
    hertz: Sequence[float], damping: float, part: float, dt: float
) -> dict[str, Any]:
    """Field `uncertainty.response` of a machine file: largest |G_true / G - 1| of every axis.

    The resonance of an axis is a factor R(s) = w^2 / (s^2 + 2 z w s + w^2). Of a true one of w' and
    z', G_true / G = R'(s) / R(s) at s = j 2 pi f, whatever the rest of the axis is.

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
    frequencies = hertz * parts
    return frequencies[frequencies < 0.5 / dt]


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


SAMPLES = 8192  # of a run that have noise of their own; the last one holds beyond
FARTHEST = 3.0  # deviations that noise never exceeds, so that it has a bound


def rounding_noise(positions: int, resolution: float | np.ndarray) -> Float[Array, "T q"]:
    """Noise of positions [m], even within half a count of all or of each; the same in every run.

    >>> noise = rounding_noise(2, 1e-6)
    >>> noise.shape, bool(abs(noise).max() <= 0.5e-6)
    ((8192, 2), True)
    """
    counts = np.random.default_rng(0).uniform(-0.5, 0.5, (SAMPLES, positions))
    return placed(resolution * counts)


def sensor_noise(positions: int, deviation: float | np.ndarray) -> Float[Array, "T q"]:
    """Gaussian noise of positions [m], within three deviations; the same in every run.

    Args:
        positions: how many.
        deviation: standard deviation [m], of all or of each.
    """
    drawn = np.random.default_rng(1).standard_normal((SAMPLES, positions))
    return placed(deviation * np.clip(drawn, -FARTHEST, FARTHEST))


def in_words(resolution: float | np.ndarray) -> str:
    """Counts of all axes, or of each.

    >>> in_words(1e-6), in_words(np.array([1e-6, 5e-6]))
    ('1 um', '1, 5 um')
    """
    return ", ".join(f"{1e6 * count:g}" for count in np.atleast_1d(resolution)) + " um"
