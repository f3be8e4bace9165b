"""Trajectory, errors and costs behind the tables of Alter & Tsao."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial
from scipy.optimize import brentq

from experiments.papers.alter_tsao.published import (
    TABLE_1,
    TABLE_3,
    PublishedCosts,
    PublishedLine,
)
from experiments.papers.verdicts import Verdict, rounds_to, verdict
from jcontour.controllers.feedforward.hinf import hinf_optimum
from jcontour.controllers.feedforward.l1 import l1_optimum
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.model_matching import ModelMatching
from jcontour.controllers.feedforward.unit_circle import corollary_1
from jcontour.plants.linear_motor_drive import ZERO

SECOND_DIFFERENCE = 1.9e-6  # [m] per sample^2, 7.6 m/s^2 at 2 kHz
PHASES = ((200, 0), (100, 1), (40, 0), (100, -1), (200, 0), (100, -1), (40, 0), (100, 1))
PERIOD = sum(count for count, _ in PHASES)
NEAR = 7.5e-9  # [m]; single precision in the simulation moves the maxima by 0.4 to 12 nm
INTERVAL = -0.3078 + 1e-6 * np.arange(801)  # of b, up to -0.3070
PROGRAM_TAPS = 40
SEARCHED_EPS = (0.05, 1.0)

Signal = Float[np.ndarray, " T"]
Taps = Float[np.ndarray, " c"]


@dataclass(frozen=True)
class Line(PublishedLine):
    """Line of Table 1, simulated: errors over one period of the trajectory [m]."""

    l1_cost: float
    hinf_cost: float
    gap: float  # between the cost and the dual's bound
    max_error: float
    rms_error: float
    max_verdict: Verdict
    rms_verdict: Verdict


@dataclass(frozen=True)
class Costs(PublishedCosts):
    """Row of Table 2."""

    value: float  # |M(b)|
    limit: float
    optimal: float  # 2 |M(b)| / (1 - b), Corollary 1
    by_program: float  # the same by linear programming
    attainable: float  # smaller where T and G share lambda = 1


@dataclass(frozen=True)
class Line30:
    """Table 3, line 30: the eps that its printed numbers imply, and what other filters give."""

    eps_from_max: float
    eps_from_rms: float
    limit_max: float  # eps -> 0 [m]
    limit_rms: float
    optimal_max: float  # of the l1-optimal FIR filter [m]


def trajectory() -> Signal:
    """One period of Fig. 2 [m]: out along parabolas, and back."""
    second = np.concatenate([np.full(count, float(sign)) for count, sign in PHASES])
    return np.cumsum(np.cumsum(SECOND_DIFFERENCE * second))


def periodic(taps: Taps, reference: Signal) -> Signal:
    """Steady response of an FIR filter to a periodic reference."""
    rolled = [tap * np.roll(reference, k) for k, tap in enumerate(taps)]
    return np.sum(rolled, axis=0)


def periodic_ratio(numerator: Taps, denominator: Taps, reference: Signal) -> Signal:
    """Steady response of a filter to a periodic reference, harmonic by harmonic."""
    points = np.exp(-2j * np.pi * np.arange(PERIOD // 2 + 1) / PERIOD)
    ratio = polynomial.polyval(points, numerator) / polynomial.polyval(points, denominator)
    return np.fft.irfft(ratio * np.fft.rfft(reference), PERIOD)


def rms(signal: Signal) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(signal**2)))


def peak(signal: Signal) -> float:
    """Largest absolute value."""
    return float(np.max(np.abs(signal)))


def following_of(row: PublishedLine | PublishedCosts) -> ModelFollowing:
    """Numbers of a row."""
    return ModelFollowing(row.order, row.preview, row.constraint)


def tracking_taps(row: PublishedLine, zero: float) -> Taps:
    """Error against the reference itself of a row's l1 optimum."""
    following = following_of(row)
    optimum = l1_optimum(following.matching(np.array([0.0, zero])))
    return following.tracking_error(optimum)[0]


def line_error(row: PublishedLine, zero: float) -> Signal:
    """Error of a line over one period [m]; sample k is the error at time k - N_p."""
    return periodic(tracking_taps(row, zero), trajectory())


def line(row: PublishedLine, zero: float) -> Line:
    """A line of Table 1."""
    problem = following_of(row).matching(np.array([0.0, zero]))
    optimum = l1_optimum(problem)
    error, other = line_error(row, zero), line_error(row, ZERO)
    return Line(
        **vars(row),
        l1_cost=optimum.cost,
        hinf_cost=hinf_optimum(problem).cost,
        gap=optimum.gap,
        max_error=peak(error),
        rms_error=rms(error),
        max_verdict=_verdict(peak(error), peak(other), row.printed_max),
        rms_verdict=_verdict(rms(error), rms(other), row.printed_rms),
    )


def _verdict(value: float, with_printed_zero: float, printed: str) -> Verdict:
    """Reproduced to the printed digits; else near: by rounding, by the zero, or by one digit."""
    if rounds_to(value, printed):
        return Verdict.REPRODUCED
    mantissa, _, exponent = printed.partition("e")
    # line 18 alone has a digit more than its neighbours
    shorter = mantissa.endswith("00") and rounds_to(value, f"{mantissa[:-1]}e{exponent}")
    near = abs(value - float(printed)) <= NEAR
    return verdict(False, near or shorter or rounds_to(with_printed_zero, printed))


def zero_interval() -> tuple[float, float]:
    """First and last b for which the maxima of lines 3 to 11 round to the print.

    Eq. 8: the error is b^(N_p - 1) times the trajectory.
    """
    amplitude = peak(trajectory())
    rows = [row for row in TABLE_1 if 3 <= row.line <= 11]
    fits = [
        b
        for b in INTERVAL
        if all(rounds_to(amplitude * abs(b) ** (row.preview - 1), row.printed_max) for row in rows)
    ]
    return float(fits[0]), float(fits[-1])


def costs(row: PublishedCosts, zero: float) -> Costs:
    """Costs with integral action in the feedback; the zero at the origin is factored out."""
    following = following_of(row)
    wanted, weight = (
        float(polynomial.polyval(zero, taps)) for taps in (following.response, following.weight)
    )
    value = wanted / (weight * zero)
    proven = corollary_1(value, zero)
    through = value / (1 - zero) * np.array([1.0, -1.0])  # M(b) at b and 0 at 1
    program = l1_optimum(ModelMatching([zero], through), on_circle=[1.0], taps=PROGRAM_TAPS)
    return Costs(
        **vars(row),
        value=abs(value),
        limit=proven.limit,
        optimal=proven.attainable,
        by_program=program.cost,
        attainable=abs(value) if row.constraint else proven.attainable,
    )


def line_30(zero: float) -> Line30:
    """The eps of the authors' filter, from their maximum and from their RMS error."""
    reference, row = trajectory(), TABLE_3[0]
    value = zero ** (row.preview - 1)

    def error(eps: float) -> Signal:
        return periodic_ratio(value * np.array([1.0, -1.0]), np.array([1 + eps, -1.0]), reference)

    def eps_of(size, printed: str) -> float:
        found = brentq(lambda eps: size(error(eps)) - float(printed), *SEARCHED_EPS, xtol=1e-14)
        return float(np.asarray(found))

    limit = value * (reference - reference.mean())
    step = value / (1 - zero) * (np.roll(reference, -1) - reference)
    return Line30(
        eps_from_max=eps_of(peak, row.printed_max),
        eps_from_rms=eps_of(rms, row.printed_rms),
        limit_max=peak(limit),
        limit_rms=rms(limit),
        optimal_max=peak(step),
    )


def zpetc_apart(zero: float) -> float:
    """Difference between line 28 and the error of zero phase error tracking."""
    row = TABLE_1[27]
    factor = np.array([-zero, 1.0])
    # lambda Bu(l) Bu(1/l) / Bu(1)^2
    mirrored = np.convolve(factor, factor[::-1]) / factor.sum() ** 2
    zero_phase = polynomial.polysub([0.0, 0.0, 1.0], np.concatenate([[0.0], mirrored]))
    return float(np.max(np.abs(polynomial.polysub(zero_phase, tracking_taps(row, zero)))))
