"""PI control with filters, tuned on the lines of a measured frequency response.

    L(s) = K (1 + 1 / (T_n s)) F(s) N(s) G(s),    F = w_l^2 / (s^2 + 2 D w_l s + w_l^2),
    N = (s^2 + 2 d_z w_n s + w_n^2) / (s^2 + 2 d_p w_n s + w_n^2)

with the measured G: a low-pass F and a notch N, as drives have them. T_n is ten times 1 / w_c of
the crossover w_c: the integrator takes 6 degrees there. K sets the crossover, the filters make the
largest sensitivity small, with one deviation of every line against the loop:

    Ms = max 1 / (|1 + L| - |L| deviation)

There is no model: what the lines show is what the loop is judged by.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.ndimage import median_filter
from scipy.optimize import minimize

INTEGRAL = 10.0  # T_n over 1 / w_c
LOWPASS = 0.7071  # damping
STARTS = 4  # resonances that a notch is tried on
TRIED = 40  # crossovers
STEPS = 400  # of a search
LOW = 20.0  # low-pass over crossover, at first
HIGHEST = 0.9  # of the last line
CALM = 0.8  # coherence of a line that the loop is judged by
SURE = 1.01  # of a crossover, that is the last one
UNSTABLE = 1e3  # sensitivity of a line that its deviation may hold unstable


@dataclass(frozen=True)
class MeasuredResponse:
    """Lines of a frequency response."""

    frequency: Float[np.ndarray, " F"]  # [Hz], ascending
    value: Complex[np.ndarray, " F"]  # output per input
    coherence: Float[np.ndarray, " F"]  # 1 where none is given

    @property
    def deviation(self) -> Float[np.ndarray, " F"]:
        """Deviation of every line over its size, at least: sqrt((1 - g^2) / (2 g^2)).

        Of one average, by the coherence g^2; Bendat & Piersol, Random Data, 4th ed., section 9.1.
        """
        square = np.clip(self.coherence, 1e-6, 1.0)
        return np.sqrt((1 - square) / (2 * square))

    def part(self, kept: Bool[np.ndarray, " F"]) -> "MeasuredResponse":
        """Some of the lines."""
        return MeasuredResponse(self.frequency[kept], self.value[kept], self.coherence[kept])

    @property
    def calm(self) -> "MeasuredResponse":
        """The lines of a coherence that a loop can be judged by."""
        return self.part(self.coherence >= CALM)


@dataclass(frozen=True)
class ResponseLoop:
    """A PI control with two filters."""

    gain: float  # K [input per output]
    reset_time: float  # T_n [s]
    lowpass: float  # w_l / 2 pi [Hz]
    notch: float  # w_n / 2 pi [Hz]
    depth: float  # d_z
    width: float  # d_p

    def response(self, frequency: Float[np.ndarray, " F"]) -> Complex[np.ndarray, " F"]:
        """Control over error at frequencies [Hz]."""
        s = 2j * np.pi * frequency
        low, place = s / (2 * np.pi * self.lowpass), s / (2 * np.pi * self.notch)
        filters = (1 + 2 * self.depth * place + place**2) / (1 + 2 * self.width * place + place**2)
        return (
            self.gain * (1 + 1 / (s * self.reset_time)) * filters / (1 + 2 * LOWPASS * low + low**2)
        )


def sensitivity(
    loop: Complex[np.ndarray, " F"], deviation: Float[np.ndarray, " F"] | float = 0.0
) -> Float[np.ndarray, " F"]:
    """Largest |1 / (1 + L)| within a relative deviation of L."""
    return 1 / np.maximum(np.abs(1 + loop) - np.abs(loop) * deviation, 1 / UNSTABLE)


def crossover(frequency: Float[np.ndarray, " F"], loop: Complex[np.ndarray, " F"]) -> float:
    """Last frequency at which |L| falls below one [Hz]; nan without one."""
    size = np.log(np.abs(loop))
    falls = np.flatnonzero((size[:-1] >= 0) & (size[1:] < 0))
    if not falls.size:
        return float("nan")
    k = int(falls[-1])
    part = size[k] / (size[k] - size[k + 1])
    return float(frequency[k] ** (1 - part) * frequency[k + 1] ** part)


def tuned(lines: MeasuredResponse, wanted: float) -> ResponseLoop:
    """The control of a crossover [Hz], within the lines, with the least largest sensitivity.

    Raises:
        ValueError: the crossover is not within the lines.
    """
    frequency, value, deviation = lines.frequency, lines.value, lines.deviation
    if not frequency[0] < wanted < frequency[-1]:
        raise ValueError(
            f"crossover: needs to be between {frequency[0]:.4g} and {frequency[-1]:.4g} Hz, "
            f"received {wanted:.4g}"
        )

    def control(x: np.ndarray) -> ResponseLoop:
        low, place = wanted * np.exp(np.abs(x[:2]))
        width = np.exp(-np.abs(x[3]))
        depth = width * np.exp(-np.abs(x[2]))
        controller = ResponseLoop(1.0, INTEGRAL / (2 * np.pi * wanted), low, place, depth, width)
        size = np.log(np.abs(controller.response(frequency) * value))
        return replace(controller, gain=float(np.exp(-np.interp(np.log(wanted), logarithm, size))))

    def worst(x: np.ndarray) -> float:
        loop = control(x).response(frequency) * value
        if not stable(loop) or crossover(frequency, loop) > SURE * wanted:
            return UNSTABLE
        return float(sensitivity(loop, deviation).max())

    logarithm = np.log(frequency)
    starts = [[np.log(LOW), np.log(place / wanted), 1.0, 1.0] for place in _peaks(lines, wanted)]
    searches = [
        minimize(worst, start, method="Nelder-Mead", options={"maxiter": STEPS}) for start in starts
    ]
    return control(min(searches, key=lambda one: one.fun).x)


def quickest(lines: MeasuredResponse, most: float) -> ResponseLoop:
    """The control of the highest crossover whose largest sensitivity is at most `most`.

    Raises:
        ValueError: none of those that were tried is.
    """
    for wanted in np.geomspace(lines.frequency[-1] / 4, 4 * lines.frequency[0], TRIED):
        candidate = tuned(lines, wanted)
        loop = candidate.response(lines.frequency) * lines.value
        once = crossover(lines.frequency, loop) <= SURE * wanted
        if once and stable(loop) and sensitivity(loop, lines.deviation).max() <= most:
            return candidate
    raise ValueError(f"no crossover within the lines has a sensitivity of at most {most:g}")


def stable(loop: Complex[np.ndarray, " F"]) -> bool:
    """Whether 1 + L does not go around zero, where L comes from a stable plant and integrators.

    L is small at the last line, where the angle of 1 + L is near zero. Back at the first it is that
    of L, which a plant that falls and an integrator take to between -270 and 90 degrees.
    """
    angle = np.unwrap(np.angle(1 + loop)[::-1])[-1]
    return bool(-1.5 * np.pi < angle < 0.5 * np.pi)


def _peaks(lines: MeasuredResponse, wanted: float) -> Float[np.ndarray, " _"]:
    """Frequencies above the crossover at which the response, times its frequency, peaks most."""
    frequency = lines.frequency
    size = np.log(np.abs(lines.value) * frequency)
    around = median_filter(size, size=max(len(size) // 20, 5), mode="nearest")
    inside = (frequency > wanted) & (frequency < HIGHEST * frequency[-1])
    over = np.where(inside, size - around, -np.inf)
    top = (over[1:-1] >= over[:-2]) & (over[1:-1] > over[2:])
    places = np.flatnonzero(top) + 1
    return frequency[places[np.argsort(-over[places])][:STARTS]]
