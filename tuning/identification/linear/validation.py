"""What a record shows of an axis, and what it does not.

Intervals of the frequency response, in the band where they are narrow; whether what is left is
noise; whether friction, saturation or another axis is behind it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import nnls
from scipy.signal import fftconvolve, lfilter, welch
from scipy.stats import norm

from tuning.identification.linear.output_error import (
    AxisFit,
    driven,
    shifted,
    solved,
    structure_of,
    triangle_of,
    whitened,
)

CONFIDENCE = 0.95
LAGS = 50  # of the autocorrelation in the covariance and in the test for whiteness
POINTS = 120  # of a frequency response
SHOWN = 0.1  # widest 95 % interval, relative, that counts as shown
HIGHEST = 0.8  # of half the sampling rate
EXTREME, STUCK = 1e-9, 5  # of the range; samples in a row at an extreme that are no coincidence
DRAGS = ("friction", "offset")  # what may act in the place of the command, in this order
HALVES = (1, 2, 4, 8)  # samples on either side of a sign of the speed
# counts, or deviations of the noise: usual motion that is clear, and least one that has a sign
CLEAR, SLOW = 10.0, 4.0
BLOCK = 500  # samples in which noise pulls by itself
CHANCE = 5.0  # standard deviations of the mean square of a Gaussian
SPECTRUM = 2048  # samples of one spectrum of many
FEW = 20.5  # counts between neighbouring positions; of a continuous record they are thousands
WHOLE = 0.1  # of a count that printed digits may round
MOSTLY = 0.9  # of the steps
WINDOW = 10  # samples over which a speed is taken
LOOKED = 0.2  # relative width of the bands in which a spectrum is averaged
HIDDEN = 10.0  # times that a resonance of damping 0.05 answers more: one that no record shows


@dataclass(frozen=True)
class Estimate:
    """Values with names and covariance."""

    names: tuple[str, ...]  # (n,)
    values: Float[np.ndarray, " n"]  # (n,)
    covariance: Float[np.ndarray, "n n"]  # (n, n)

    def __getitem__(self, name: str) -> float:
        """Value of a name."""
        return float(self.values[self.names.index(name)])

    def deviation(self, name: str) -> float:
        """Standard deviation; infinite where rounding has taken the variance below zero."""
        k = self.names.index(name)
        variance = float(self.covariance[k, k])
        return float(np.sqrt(variance)) if variance >= 0 else np.inf

    def interval(self, name: str) -> tuple[float, float]:
        """Ends of the 95 % confidence interval."""
        half = float(norm.ppf((1 + CONFIDENCE) / 2)) * self.deviation(name)
        return self[name] - half, self[name] + half


def coloured_covariance(
    jacobians: Sequence[Float[np.ndarray, "_ n"]], correlations: Sequence[Float[np.ndarray, " _"]]
) -> Float[np.ndarray, "n n"]:
    """Covariance of a least-squares fit to runs of rows without gaps, whose residuals are coloured.

    To first order theta - truth = -(J'J)^-1 J'e of residuals e with the autocorrelation c
    (Klein & Morelli, Aircraft System Identification, 2006, section 5.3):

        cov = (J'J)^-1  [sum_kl J_k' c(k - l) J_l]  (J'J)^-1
    where the usual s^2 (J'J)^-1 promises too much. Run k has a Jacobian (T_k, n), and its residuals
    have the autocorrelation `correlations[k]`.
    """
    spread, information = 0.0, 0.0
    for J, one_sided in zip(jacobians, correlations, strict=True):
        c = one_sided[: len(J)]
        two_sided = np.concatenate([c[:0:-1], c])[:, None]
        spread = spread + J.T @ fftconvolve(J, two_sided, axes=0)[len(c) - 1 : len(c) - 1 + len(J)]
        information = information + J.T @ J
    inverse = scaled_inverse(np.asarray(information))
    with np.errstate(invalid="ignore"):  # infinite where nothing is seen
        return inverse @ np.asarray(spread) @ inverse


def autocorrelation(
    residuals: Sequence[Float[np.ndarray, " _"]], lags: int
) -> Float[np.ndarray, " {lags}+1"]:
    """Mean of r(k) r(k + l) for l = 0..lags, tapered to nothing over the second half of the lags.

    The flat top keeps correlations of up to half the lags unbiased (Politis & Romano, J. Time
    Series Analysis 16, 1995).
    """
    rows = sum(len(r) for r in residuals)

    def product(lag: int) -> float:
        return sum(float(r[: max(len(r) - lag, 0)] @ r[lag:]) for r in residuals)

    products = np.array([product(lag) for lag in range(lags + 1)])
    taper = np.minimum(1, 2 * (1 - np.arange(lags + 1) / (lags + 1)))
    return products / rows * taper


def scaled_inverse(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Inverse of a positive matrix whose rows may differ by many orders of magnitude.

    Directions that are not seen come out huge, or infinite.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    values = np.maximum(values, np.finfo(float).eps * len(scale))
    with np.errstate(over="ignore"):
        return (vectors / values) @ vectors.T / np.outer(scale, scale)


@dataclass(frozen=True)
class Response:
    """Frequency response with its interval."""

    frequency: Float[np.ndarray, " F"]  # [Hz]
    value: Complex[np.ndarray, " F"]  # G
    half_width: Float[np.ndarray, " F"]  # of the 95 % interval, over |G|

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies between which the interval stays narrow [Hz]; nan where it never is."""
        narrow = self.half_width < SHOWN
        if not narrow.any():
            return np.nan, np.nan
        best = int(np.argmin(self.half_width))
        wide = np.flatnonzero(~narrow)
        low = wide[wide < best].max(initial=-1) + 1
        high = wide[wide > best].min(initial=len(narrow)) - 1
        return float(self.frequency[low]), float(self.frequency[high])


def estimate_of(fit: AxisFit) -> Estimate:
    """Coefficients a, b (and the drags f) of a fit, with the covariance of coloured residuals.

    It grows by the `dispersion`: what a model lacks widens every interval.
    """
    n, m = len(fit.model.denominator), len(fit.model.numerator)
    covariance = dispersion(fit) * coloured_covariance(
        [fit.jacobian], [autocorrelation([fit.errors], min(LAGS, len(fit.errors) - 1))]
    )
    names = tuple(f"a{i + 1}" for i in range(n)) + tuple(f"b{i + 1}" for i in range(m))
    values = np.concatenate([fit.model.denominator, fit.model.numerator])
    names += DRAGS[: len(fit.drag)]
    values = np.concatenate([values, fit.drag])
    size = len(names)
    return Estimate(names, values, covariance[:size, :size])


def response_of(
    fit: AxisFit, estimate: Estimate, frequency: Float[np.ndarray, " F"] | None = None
) -> Response:
    """Frequency response of a fit; where no frequencies [Hz] are given, at those of its record.

    They go from three periods in it up to `HIGHEST` of half the sampling rate.
    """
    rows, dt = len(fit.residual), fit.model.dt
    if frequency is None:
        frequency = np.geomspace(3 / (rows * dt), HIGHEST / (2 * dt), POINTS)
    value, slopes = fit.model.log_terms(2 * np.pi * frequency)
    size = slopes.shape[1]
    covariance = estimate.covariance[:size, :size]
    # the larger axis of the ellipse in which ln G lies
    real, imaginary = np.real(slopes), np.imag(slopes)
    a = np.einsum("fi,ij,fj->f", real, covariance, real)
    c = np.einsum("fi,ij,fj->f", imaginary, covariance, imaginary)
    b = np.einsum("fi,ij,fj->f", real, covariance, imaginary)
    largest = (a + c) / 2 + np.sqrt(((a - c) / 2) ** 2 + b**2)
    factor = float(norm.ppf((1 + CONFIDENCE) / 2))
    half = factor * np.sqrt(np.maximum(largest, 0.0))
    return Response(frequency, np.exp(value), np.where(np.isfinite(half), half, np.inf))


def excited_to(
    response: Response, position: Float[np.ndarray, " T"], residual: Float[np.ndarray, " T"]
) -> float:
    """Highest frequency [Hz] up to which the record itself holds the response; 0 where none does.

    With the spectra S_y of what the model answers and S_r of what it leaves, n independent lines
    of a band tell the response there to

        1.96 sqrt(S_r / (n S_y)),

    whatever the model: its own interval is narrow where nothing moved as well.
    """
    rows, dt = min(SPECTRUM, len(position) // 4), 0.4 / response.frequency[-1]
    sums = []
    for signal in (residual, position - residual):
        hertz, power = welch(np.diff(signal, 2), 1 / dt, "blackmanharris", rows)
        sums.append(np.append(0.0, np.cumsum(power)))
    band = response.frequency * (1 + LOOKED / 2 * np.array([[-1.0], [1.0]]))
    low, high = np.searchsorted(hertz, band)
    high = np.maximum(high, low + 1)
    left, answer = (one[high] - one[low] for one in sums)
    lines = np.maximum(LOOKED * response.frequency * len(position) * dt, 1.0)
    told = 1.96 * np.sqrt(left / np.maximum(answer, 1e-300) / lines) < SHOWN
    return float(response.frequency[told].max(initial=0.0))


def as_excited(response: Response, hertz: float) -> Response:
    """The response, with that of a hidden resonance where nothing is shown any more.

    A loop may take up half of an interval, so that half of `HIDDEN` stands for it.
    """
    above = response.frequency > min(response.band[1], hertz)
    held = np.where(above, np.maximum(response.half_width, HIDDEN / 2), response.half_width)
    return replace(response, half_width=held)


def dispersion(fit: AxisFit) -> float:
    """By how much the errors pull at the coefficients more than noise does, as a variance.

    In blocks of a fixed length: noise pulls in each its own way, what a model lacks pulls on in the
    same one. With Q of J = Q R, and z_p = sum_k Q_k e_k over a block, noise leaves
    sum_p z_p z_p' = sigma^2 I. One is returned where it may be chance: the trace has a variance of
    2 sigma^4 sum_p |Q_p' Q_p|^2.
    """
    J = fit.jacobian[:, np.any(fit.jacobian != 0, axis=0)]
    scale = np.sqrt((J**2).sum(axis=0))
    base, _ = np.linalg.qr(J / scale)
    starts = np.arange(0, len(fit.errors), BLOCK)
    pulls = np.add.reduceat(base * fit.errors[:, None], starts, axis=0)
    shares = np.add.reduceat(base[:, :, None] * base[:, None, :], starts, axis=0)
    variance = float(fit.errors @ fit.errors) / max(len(fit.errors) - J.shape[1], 1)
    found = float((pulls**2).sum()) / (J.shape[1] * max(variance, 1e-300))
    chance = np.sqrt(2 * float((shares**2).sum())) / J.shape[1]
    return found if found > 1 + CHANCE * chance else 1.0


def correlations(fit: AxisFit) -> Float[np.ndarray, " lags"]:
    """Autocorrelation of the errors over their variance, from lag one on."""
    lags = min(LAGS, len(fit.errors) - 1)
    errors = fit.errors - fit.errors.mean()
    products = np.array([errors[lag:] @ errors[: len(errors) - lag] for lag in range(lags + 1)])
    return products[1:] / products[0]


def saturated(command: Float[np.ndarray, " T"]) -> float:
    """Part of the samples at which the command stands at an extreme of its own."""
    span = float(np.ptp(command))
    stuck = 0
    for level in (command.min(), command.max()):
        at = np.abs(command - level) <= EXTREME * span
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(int), [0]])))
        runs = edges[1::2] - edges[::2]
        stuck += int(runs[runs >= STUCK].sum())
    return stuck / len(command)


def speed_signs(position: Float[np.ndarray, " T"], resolution: float) -> Float[np.ndarray, " T"]:
    """Minus the sign of the speed, zero at a standstill: Coulomb friction in the command's place.

    The speed from sample k to k+1, in the middle of as few samples as counts and noise allow.
    """
    unclear = max(resolution, np.sqrt(2) * noise_of(position))
    moved = np.zeros(len(position))
    for half in HALVES:
        padded = np.pad(position, (half - 1, half), mode="edge")
        moved = padded[2 * half - 1 :] - padded[: len(position)]
        if np.median(np.abs(moved)) > CLEAR * unclear:
            break
    return -np.where(np.abs(moved) > SLOW * unclear, np.sign(moved), 0.0)


def noise_of(position: Float[np.ndarray, " T"]) -> float:
    """Standard deviation of white noise on a smooth position [m], by its fourth differences."""
    fourth = np.abs(np.diff(position, 4))
    return float(np.median(fourth)) / (norm.ppf(0.75) * np.sqrt(70))


def resolution_of(position: Float[np.ndarray, " T"]) -> float:
    """Smallest step between any two positions [m], the count of the encoder.

    Where they are not counted, most steps no few of it, it is at least a tenth of what noise as
    large would count.
    """
    places = np.unique(position)
    steps = np.diff(places)
    steps = steps[steps > 1e-9 * max(float(np.ptp(position)), 1e-300)]
    least = float(steps.min()) if steps.size else 0.0
    if steps.size and np.median(steps) < FEW * least:
        counts = steps / least
        if np.mean(np.abs(counts - np.round(counts)) < WHOLE) > MOSTLY:
            return least
    return max(least, 0.1 * np.sqrt(12) * noise_of(position))


def coupling(fit: AxisFit, other: Float[np.ndarray, " T"]) -> tuple[float, float]:
    """Part of the errors that another axis's command explains, and its F number.

    The command comes through this axis's own denominator with a numerator of its own.
    """
    structure = structure_of(fit.model)
    below = np.concatenate([[1.0], fit.model.denominator])
    drive = np.asarray(lfilter([1.0], below, driven(other, structure)))
    drive = whitened(drive, fit.filter)
    own = fit.jacobian
    new = np.stack([shifted(drive, i)[fit.rows] for i in range(1, structure.zeros + 1)], axis=1)
    before = _left(own, fit.errors)
    after = _left(np.concatenate([own, new], axis=1), fit.errors)
    freedom = len(fit.errors) - own.shape[1] - new.shape[1]
    number = (before - after) / new.shape[1] / max(after / freedom, 1e-300)
    return max(1 - after / before, 0.0), float(number)


def _left(columns: np.ndarray, right: np.ndarray) -> float:
    scale = np.sqrt((columns**2).sum(axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    both = np.concatenate([columns / scale, right[:, None]], axis=1)
    return float(triangle_of(both)[-1, -1] ** 2)


def fastest_growth(command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"]) -> float:
    """Largest pole of a second-order least-squares model: the part by which it grows a sample.

    y(k) = -a_1 y(k-1) - a_2 y(k-2) + b_1 u(k-1) + b_2 u(k-2) + c: unbiased where the noise comes to
    the equation, as it does where an unstable axis enlarges it.
    """
    u, y = command, position
    columns = np.column_stack([y[1:-1], y[:-2], u[1:-1], u[:-2], np.ones(len(y) - 2)])
    found = solved(columns, y[2:])
    return float(np.abs(np.roots([1.0, -found[0], -found[1]])).max())


NOISE_SPECTRUM = 1024  # samples of one spectrum of many
LOWEST = 0.05  # of the sampling rate: below, whatever a model lacks is largest
ROUNDS = 10
MORE = 0.2  # of the variance of rounding: a smaller part of it may be chance
SEEN = 0.5  # of the spectrum at its highest frequency: less hides behind what comes to the command


def encoder_noise(fit: AxisFit, resolution: float) -> float:
    """Standard deviation of the noise of an encoder beside its rounding [m]; 0 where none is sure.

    What a model leaves is noise w on the command, behind the model, and e on the position, both
    white (e.g. Ljung, System Identification, 1999, section 4.2):

        S_r(f) = |G(f)|^2 S_w + S_e,      S_w, S_e >= 0
    G falls with the frequency, so their shapes tell the two apart. The noise of the encoder is what
    e has more than rounding, whose variance is a twelfth of a squared count.

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
    hertz, spectrum = welch(fit.residual, 1 / dt, nperseg=min(NOISE_SPECTRUM, len(inside)))
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
