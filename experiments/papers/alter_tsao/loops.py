"""The paper's controllers in an explicit loop with the example drive, sample by sample."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from experiments.papers.alter_tsao.runs import (
    SECOND_DIFFERENCE,
    Signal,
    Taps,
    peak,
    periodic,
    trajectory,
)
from jcontour.controllers.feedforward.model_following import (
    ModelFollowing,
    parallel_feedforward,
    shortest_error,
)
from jcontour.controllers.feedforward.unit_circle import l1_norm, perturbed_error
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transfer_functions import TransferFunction, transfer_function
from jcontour.plants.linear_motor_drive import ZERO, bandwidth_of_zero, linear_motor_drive

CROSSOVER = 250.0  # [rad/s], chosen: the authors' controllers are not printed
RUNS = {  # (m, N_p, N) in the loop; integral action needs N >= 1 where no eps is given
    "A": ((0, 2, 0), (0, 0, 1), (0, 0, 2), (1, 3, 2), (0, 1, 2), (2, 3, 2), (0, 9, 1), (0, 2, 2)),
    "B": ((0, 0, 1), (0, 0, 2), (1, 3, 2), (0, 1, 2), (2, 3, 2), (0, 9, 1), (0, 2, 2)),
}
SWEEP = (1.0, 0.3, 0.1, 0.01, 1e-3, 1e-4)  # eps
GRID = 20_001  # frequencies from 0 to pi


@dataclass(frozen=True)
class LoopRun:
    """One controller in the loop with the example drive, from rest, over its second period."""

    controller: str
    order: int
    preview: int
    constraint: int
    max_error: float  # [m]
    apart: float  # from the filter E_track [m]
    per_acceleration: float  # largest model following error over largest second difference
    slowest_pole: float  # smallest modulus in lambda: above one is stable


@dataclass(frozen=True)
class Perturbed:
    """Cost of the suboptimal filter with the unit-circle zero moved by eps."""

    eps: float
    l1: float
    hinf: float


@dataclass(frozen=True)
class Feedback:
    """C_fb in lambda."""

    numerator: Taps
    denominator: Taps
    shared: tuple[float, ...]  # what C_ff has in common with it


def feedbacks(plant: LinearPlant) -> dict[str, Feedback]:
    """A, a lead with unit loop gain at the crossover; B, the same with an integrator.

    C(s) = k (3 s/w + 1) / (s/(3 w) + 1), for B times (s + w/10)/s; Tustin.
    """
    w, dt, bandwidth = CROSSOVER, plant.dt, bandwidth_of_zero(ZERO)
    s = 1j * w
    drive = bandwidth / (s**2 * (s + bandwidth))
    lead = (np.array([1.0, 3 / w]), np.array([1.0, 1 / (3 * w)]))  # ascending in s
    integral = (np.array([w / 10, 1.0]), np.array([0.0, 1.0]))
    forms = {
        "A": (lead, (1.0,)),
        "B": (tuple(np.convolve(a, b) for a, b in zip(lead, integral, strict=True)), (-1.0, 1.0)),
    }
    found = {}
    for name, ((top, below), shared) in forms.items():
        response = polynomial.polyval(s, top) / polynomial.polyval(s, below)
        gain = 1 / abs(drive * response)
        numerator, denominator = _tustin(gain * top, dt), _tustin(below, dt)
        scale = denominator[0]
        found[name] = Feedback(numerator / scale, denominator / scale, shared)
    return found


def _tustin(coefficients: Taps, dt: float) -> Taps:
    """Numerator of a polynomial in s = (2 / dt) (1 - lambda) / (1 + lambda)."""
    degree = len(coefficients) - 1
    found = np.zeros(degree + 1)
    for k, coefficient in enumerate(coefficients):
        minus = polynomial.polypow([1.0, -1.0], k)
        plus = polynomial.polypow([1.0, 1.0], degree - k)
        found = found + coefficient * (2 / dt) ** k * np.convolve(minus, plus)
    return found


def loop_runs(zero: float) -> tuple[LoopRun, ...]:
    """Every controller in the loop, from rest."""
    drive = linear_motor_drive(bandwidth_of_zero(zero))
    plant = transfer_function(drive)
    by_name = feedbacks(linear_motor_drive())
    return tuple(
        _loop(drive, plant, name, by_name[name], ModelFollowing(*numbers))
        for name, sets in RUNS.items()
        for numbers in sets
    )


def _loop(
    drive: LinearPlant,
    plant: TransferFunction,
    name: str,
    feedback: Feedback,
    following: ModelFollowing,
) -> LoopRun:
    zeros = np.concatenate([[0.0], plant.zeros[np.abs(plant.zeros) < 1]])
    taps = shortest_error(following.matching(zeros))
    wanted = polynomial.polysub(following.response, np.convolve(following.weight, taps))
    pair = (feedback.numerator, feedback.denominator)
    forward = parallel_feedforward(plant, pair, wanted, feedback.shared)
    period = trajectory()
    reference = np.tile(period, 3)
    output = simulated(drive, feedback, forward, reference[following.preview :])[: 2 * period.size]
    second = slice(period.size, 2 * period.size)
    # sample k of the loop sees r(k + N_p) and should be at r(k)
    error = (reference[: 2 * period.size] - output)[second]
    track = polynomial.polysub(np.eye(1, following.preview + 1, following.preview)[0], wanted)
    filtered = np.roll(periodic(track, period), -following.preview)
    model = np.roll(periodic(following.response, period), -following.preview)
    closed = polynomial.polyadd(
        np.convolve(plant.numerator, feedback.numerator),
        np.convolve(plant.denominator, feedback.denominator),
    )
    poles = np.concatenate([np.roots(closed[::-1]), np.roots(forward[1][::-1])])
    return LoopRun(
        controller=name,
        order=following.order,
        preview=following.preview,
        constraint=following.constraint,
        max_error=peak(error),
        apart=peak(error - filtered),
        per_acceleration=peak(model - output[second]) / SECOND_DIFFERENCE,
        slowest_pole=float(np.min(np.abs(poles))),
    )


def simulated(
    drive: LinearPlant, feedback: Feedback, forward: tuple[Taps, Taps], previewed: Signal
) -> Signal:
    """Output of the loop u = C_fb (r_p - y) + C_ff r_p from rest, sample by sample."""
    A, B, C = np.asarray(drive.A), np.asarray(drive.B)[:, 0], np.asarray(drive.C)[0]
    ahead = lfilter(*forward, previewed)
    back = (feedback.numerator, feedback.denominator)
    memory = np.zeros(max(map(len, back)) - 1)
    state, output = np.zeros(len(A)), np.zeros(previewed.size)
    for k, reference in enumerate(previewed):
        output[k] = C @ state
        control, memory = lfilter(*back, [reference - output[k]], zi=memory)
        state = A @ state + B * (control[0] + ahead[k])
    return output


def perturbed_costs(zero: float, sweep: Iterable[float] = SWEEP) -> tuple[Perturbed, ...]:
    """Costs of (0, 9, 0) with controller B over eps."""
    feedback = feedbacks(linear_motor_drive())["B"]
    plant = transfer_function(linear_motor_drive(bandwidth_of_zero(zero)))
    through = np.convolve(plant.numerator, feedback.numerator)
    closed = polynomial.polyadd(np.convolve(plant.denominator, feedback.denominator), through)
    delayed = np.eye(1, 9, 8)[0]
    model = (polynomial.polysub(np.convolve(delayed, closed), through[1:]), closed)
    circle = np.exp(1j * np.linspace(0, np.pi, GRID))
    found = []
    for eps in sweep:
        top, below = perturbed_error(model, np.array([zero**8]), eps)
        response = polynomial.polyval(circle, top) / polynomial.polyval(circle, below)
        found.append(Perturbed(eps, l1_norm(top, below), float(np.max(np.abs(response)))))
    return tuple(found)
