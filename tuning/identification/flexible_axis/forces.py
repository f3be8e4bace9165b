"""Masses, friction and cogging from one balance of forces over all motion of the axis.

    M a_m + M_e (a_e - a_m) + s (f_0 - q v^2 / (1 + w v^2)) + b_v v + F_0 + F_c(x_m) = k_t i
    (3.1) + (3.2) of Yuan
with M = M_m + M_e the total mass, s the direction of sliding, F_0 a constant push of cables or
slope, and F_c the harmonics of (3.7). It holds wherever the motor slides, at any speed and
acceleration, so that plateaus of a speed sweep, runs up and vibrations all count. The friction is
the Lorentzian of (3.8) in numbers that data can tell apart: f_0 = f_c + f_s, q = f_s / v_s^2, w = 1
/ v_s^2.

All is linear but w and the pole pitch, so that these two alone are searched, the others following
by linear least squares (variable projection, Golub & Pereyra 1973).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from tuning.identification.estimates import Estimate, autocorrelation, coloured_covariance
from tuning.identification.flexible_axis.cogging import Harmonics, Spectrum, harmonics, spectrum
from tuning.identification.flexible_axis.records import Record
from tuning.identification.flexible_axis.slides import SLOWEST, WINDOW, Slide, slides

# rows, three windows, over which residuals may be correlated: windows that overlap are, and a
# little more
CORRELATED = 12
CURVATURES = (0.0, 10.0)  # starts of w, over the largest speed squared: it has local minima
# squares that w has to gain, over the variance of noise: as much as 3.5 deviations
SIGNIFICANT = 3.5**2
BOUNDS = {
    "curvature": (-0.9, np.inf),  # of w, over the largest speed squared: friction has a pole at -1
    "pole_pitch": (-0.5, 0.5),  # of the pitch's stretch
}
NO_COGGING = Harmonics(1.0, 0)
COMPLEX_STEP = 1e-30  # for derivatives that are exact to rounding


class ForceFit(NamedTuple):
    """Fitted balance of forces at a known k_t.

    Attributes:
        estimate: total_mass, tool_mass, break_away f_0, viscous, constant_force, drop q, curvature
            w, pole_pitch, sine_j, cosine_j; without tool_mass, curvature or pole_pitch where the
            data do not show it or it was given.
        slides: where the motor slid.
        residuals: of every slide (R,) [N].
        spectrum: of what is left over without cogging.
        cogging: its pole pitch before the fit, and how many harmonics are in the fit.
    """

    estimate: Estimate
    slides: list[Slide]
    residuals: list[Float[np.ndarray, " _"]]
    spectrum: Spectrum
    cogging: Harmonics

    @property
    def fastest(self) -> float:
        """Largest sliding speed [m/s]."""
        return _fastest(self.slides)


def fit_forces(
    records: Sequence[Record],
    force_constant: float,
    pole_pitch: float | None = None,
    window: float = WINDOW,
) -> ForceFit:
    """Fit all slides of all records at once.

    Args:
        records: without voltages, all of them with the end effector or none.
        force_constant: k_t [N/A].
        pole_pitch: [m] where it is known; otherwise it is the period of the strongest line, and is
            fitted.
        window: [s] of a row.

    Raises:
        ValueError: the motor hardly slides, in one direction only, or the travel is too short for
            the harmonics of cogging.
    """
    found = [slide for record in records for slide in slides(record, window)]
    if {slide.direction for slide in found} != {-1.0, 1.0}:
        raise ValueError(
            f"motion: the motor needs to slide both ways, faster than {1e3 * SLOWEST:g} mm/s "
            f"for longer than {2 * window:.2g} s at a time"
        )
    lines = _left_over(_fit(found, force_constant, NO_COGGING, ("curvature",)), found)
    cogging = harmonics(lines, pole_pitch)
    pitch = ("pole_pitch",) if cogging.highest and pole_pitch is None else ()
    fit, curved = (
        _fit(found, force_constant, cogging, searched)
        for searched in (pitch, (*pitch, "curvature"))
    )
    if _gain(fit, curved) > SIGNIFICANT:
        fit = curved
    return ForceFit(fit.estimate, found, fit.residuals, lines, cogging)


class _Fit(NamedTuple):
    estimate: Estimate
    residuals: list[Float[np.ndarray, " _"]]


def _fit(
    found: Sequence[Slide], force_constant: float, cogging: Harmonics, searched: tuple[str, ...]
) -> _Fit:
    """Least squares over all slides.

    Pole pitch and curvature are free where they are in `searched`; otherwise the pitch is the given
    one, and the curvature zero.
    """
    fixed = {"curvature": 0.0, "pole_pitch": cogging.pole_pitch}
    scale = {"curvature": _fastest(found) ** -2, "pole_pitch": cogging.pole_pitch}
    ends = np.cumsum([len(slide.time) for slide in found])[:-1]
    force = force_constant * np.concatenate([slide.current for slide in found])

    def shape(z):
        moved = zip(searched, z, strict=True)
        return fixed | {name: fixed[name] + scale[name] * x for name, x in moved}

    def columns(z):
        return np.concatenate([_columns(slide, cogging.highest, **shape(z)) for slide in found])

    def solved(z):
        matrix = columns(z)
        linear = np.linalg.lstsq(matrix, force, rcond=None)[0]
        return linear, matrix @ linear - force

    def residual(z):
        return solved(z)[1]

    z = _searched(residual, searched)
    linear, left = solved(z)
    bent = []
    for step, name in zip(COMPLEX_STEP * 1j * np.eye(len(searched)), searched, strict=True):
        bent.append((columns(z + step) @ linear).imag / COMPLEX_STEP / scale[name])
    slopes = np.split(np.column_stack([columns(z), *bent]), ends)
    residuals = np.split(left, ends)
    correlations = [autocorrelation(residuals, CORRELATED)] * len(slopes)
    names = (*_linear_names(found, cogging.highest), *searched)
    values = np.append(linear, [shape(z)[name] for name in searched])
    return _Fit(Estimate(names, values, coloured_covariance(slopes, correlations)), residuals)


def _searched(
    residual: Callable[[Float[np.ndarray, " s"]], Float[np.ndarray, " rows"]],
    searched: tuple[str, ...],
) -> Float[np.ndarray, " s"]:
    """The best of searches from several curvatures; scaled, and 0 at their fixed values."""
    if not searched:
        return np.zeros(0)
    bounds = tuple(zip(*(BOUNDS[name] for name in searched), strict=True))
    curved = np.array([float(name == "curvature") for name in searched])
    tries = [least_squares(residual, w * curved, bounds=bounds) for w in CURVATURES]
    return min(tries, key=lambda one: one.cost).x


def _gain(fit: _Fit, wider: _Fit) -> float:
    """Squares that the wider fit explains more, over the variance of its slow noise.

    Of noise alone it is a chi-square. Without noise it is infinite, or zero if both explain alike.
    """
    correlation = autocorrelation(wider.residuals, CORRELATED)
    variance = correlation[0] + 2 * correlation[1:].sum()
    squares, wider_squares = (
        float(np.sum(np.concatenate(one.residuals) ** 2)) for one in (fit, wider)
    )
    if variance == 0:
        return np.inf if squares > wider_squares else 0.0
    return (squares - wider_squares) / variance


def _columns(
    slide: Slide, count: int, curvature: float | complex, pole_pitch: float | complex
) -> np.ndarray:
    """Factors of all linear parameters (R, n), in the order of `_linear_names`."""
    squared, ones = slide.speed**2, np.ones(len(slide.time))
    fall = squared / (1 + curvature * squared) @ slide.weights
    angle = 2 * np.pi / pole_pitch * slide.position
    sine, cosine = [np.sin(angle)], [np.cos(angle)]
    for _ in range(count - 1):  # angle addition
        s, c = sine[-1], cosine[-1]
        sine.append(s * cosine[0] + c * sine[0])
        cosine.append(c * cosine[0] - s * sine[0])
    waves = [wave @ slide.weights for wave in (sine + cosine if count else [])]
    whip = [] if slide.whip is None else [slide.whip]
    return np.stack(
        [
            slide.inertia,
            *whip,
            slide.direction * ones,
            slide.drag,
            ones,
            -slide.direction * fall,
            *waves,
        ],
        axis=1,
    )


def _linear_names(found: Sequence[Slide], count: int) -> list[str]:
    tool = [] if found[0].whip is None else ["tool_mass"]
    waves = [f"{kind}_{j}" for kind in ("sine", "cosine") for j in range(1, count + 1)]
    return ["total_mass", *tool, "break_away", "viscous", "constant_force", "drop", *waves]


def _left_over(fit: _Fit, found: Sequence[Slide]) -> Spectrum:
    """Spectrum of minus the residual over the slower half of all rows.

    There windows are short against a pole pitch.
    """
    speed = np.concatenate([np.abs(slide.speed @ slide.weights) for slide in found])
    position = np.concatenate([slide.position @ slide.weights for slide in found])
    slow = speed <= np.median(speed)
    return spectrum(position[slow], -np.concatenate(fit.residuals)[slow])


def _fastest(found: Sequence[Slide]) -> float:
    return float(max(np.abs(slide.speed).max() for slide in found))
