"""l1-optimal error filters by linear programming, with a certificate.

    minimise sum |e_k|  over all filters that meet the conditions of a `ModelMatching`

The norm is the largest error over all references within +-1 (Alter & Tsao, eq. 5). The optimum is
an FIR filter (Dahleh & Pearson). Its dual,

    maximise Re sum_i a_i M(z_i)   with   |Re sum_i a_i z_i^k| <= 1 for all k,
proves that no filter is better. The samples z_i^k decay, so finitely many k decide: the program
grows until the rest is known to be below one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from numpy.polynomial import polynomial
from scipy.optimize import linprog

from jcontour.controllers.feedforward.model_matching import (
    ModelMatching,
    Polynomial,
    Zeros,
    check_pairs,
)
from jcontour.linear.transfer_functions import ON_CIRCLE

FIRST = 0.1  # length of the samples z_i^k that the first program leaves out
MOST_TAPS = 20_000
TIGHT = 1e-10  # tolerance of the solver, the smallest that it takes
USED = 1e-9  # relative size above which a tap belongs to the optimal basis
MISSED = 1e-7  # relative error of a condition that counts as missed
RANK_TOLERANCE = 1e-12  # singular values below this belong to conditions that repeat others

Circle = Complex[np.ndarray, " c"]  # zeros on the upper half of the unit circle


@dataclass(frozen=True, eq=False)
class L1Optimum:
    """An l1-optimal error filter and its certificate."""

    taps: Polynomial  # e_0, e_1,
    cost: float  # sum |e_k|
    bound: float  # value of a dual solution that is feasible for every k: no filter costs less

    @property
    def numerator(self) -> Polynomial:
        """The taps."""
        return self.taps

    @property
    def denominator(self) -> Polynomial:
        """One: the filter is finite."""
        return np.ones(1)

    @property
    def gap(self) -> float:
        """Most that another filter could save."""
        return self.cost - self.bound

    @property
    def support(self) -> tuple[int, ...]:
        """Places of the taps that are used."""
        return tuple(np.flatnonzero(np.abs(self.taps) > USED * max(self.cost, 1e-300)).tolist())


@dataclass(frozen=True, eq=False)
class _Conditions:
    """Real equations rows @ taps = values, and what bounds the rows beyond their last column."""

    rows: Float[np.ndarray, "r k"]
    values: Float[np.ndarray, " r"]
    back: Float[np.ndarray, "s r"]  # multipliers of the rows -> of the decaying samples
    rest: float  # length of the decaying samples beyond
    lasting: Float[np.ndarray, " r"]  # 1 for a row that does not decay, on the unit circle


def l1_optimum(
    problem: ModelMatching,
    on_circle: Zeros | Sequence[complex | float] = (),
    taps: int | None = None,
) -> L1Optimum:
    """The filter of least l1 norm.

    >>> optimum = l1_optimum(ModelMatching([0.0, -0.3], numerator=[0.0, 0.0, 1.0]))
    >>> round(optimum.cost, 12), optimum.support, optimum.gap < 1e-12
    (0.3, (1,), True)

    Args:
        problem: zeros and model.
        on_circle: zeros on the unit circle, where E equals M as well. Their infimum need not be
            attained; the filter found is the best of its length.
        taps: length of the filter; as many as the certificate needs when not given.

    Raises:
        ValueError: a zero of `on_circle` is not there or comes without its conjugate, or no filter
            of this length meets the conditions.
    """
    circle = _upper(on_circle)
    if problem.zeros.size + circle.size == 0:
        return L1Optimum(np.zeros(1), 0.0, 0.0)
    coefficients, bound = (
        _grown(problem, circle) if taps is None else _program(problem, circle, taps)[:2]
    )
    used = np.flatnonzero(coefficients)
    coefficients = coefficients[: used[-1] + 1] if used.size else coefficients[:1]
    return L1Optimum(coefficients, float(np.abs(coefficients).sum()), bound)


def _grown(problem: ModelMatching, circle: Circle) -> tuple[Polynomial, float]:
    """Taps and bound of the first program whose certificate holds for every k."""
    count = _first_count(problem, circle)
    while True:
        try:
            response, bound, decided = _program(problem, circle, count)
            if decided or count >= MOST_TAPS:
                return response, bound
        except ValueError:
            if count >= MOST_TAPS:
                raise
        count = 2 * count


def _program(problem: ModelMatching, circle: Circle, count: int) -> tuple[Polynomial, float, bool]:
    """Taps, bound, and whether no longer filter is better."""
    # conditions with orthonormal rows, repeated ones left out, then those of the circle
    samples = problem.powers(count) if problem.zeros.size else np.zeros((0, count), complex)
    wanted = problem.model @ problem.one if problem.zeros.size else np.zeros(0, complex)
    rest = 0.0
    if problem.zeros.size:
        rest = float(np.linalg.norm(problem.shift @ samples[:, -1]))
    both = np.concatenate([np.real(samples), np.imag(samples)])
    left, sizes, rows = np.linalg.svd(both, full_matrices=False)
    kept = sizes > RANK_TOLERANCE * max(float(np.max(sizes, initial=0.0)), 1e-300)
    back = left[:, kept] / sizes[kept]
    values = back.T @ np.concatenate([np.real(wanted), np.imag(wanted)])
    rows, lasting = rows[kept], np.zeros(int(kept.sum()))
    targets = polynomial.polyval(circle, problem.numerator) / polynomial.polyval(
        circle, problem.denominator
    )
    for zero, value in zip(circle, targets, strict=True):
        powers = zero ** np.arange(count)
        parts = ((np.real(powers), np.real(value)), (np.imag(powers), np.imag(value)))
        for row, target in parts[: 1 if np.imag(zero) == 0 else 2]:
            rows, values = np.vstack([rows, row]), np.append(values, target)
            lasting = np.append(lasting, 1.0)
    back = np.concatenate([back, np.zeros((len(back), lasting.size - back.shape[1]))], axis=1)
    conditions = _Conditions(rows, values, back, rest, lasting)
    response, multipliers = _solved(conditions)
    off_circle = np.abs(polynomial.polyval(circle, response) - targets)
    missed = max(problem.misses(response), float(np.max(off_circle, initial=0.0)))
    if missed > MISSED * max(float(np.abs(response).sum()), 1.0):
        raise ValueError(f"taps: no filter of {count} taps meets the conditions")
    # the bound: the value of the multipliers, scaled until they are feasible for every k
    lasting = np.abs(multipliers * conditions.lasting).sum()  # of the dual's samples beyond them
    beyond = float(lasting + np.linalg.norm(conditions.back @ multipliers) * conditions.rest)
    feasible = max(1.0, float(np.max(np.abs(multipliers @ rows), initial=0.0)), beyond)
    return response, float(values @ multipliers) / feasible, beyond <= 1


def _upper(on_circle: Zeros | Sequence[complex | float]) -> Circle:
    """Zeros of the upper half of the unit circle: those of the lower half repeat them."""
    zeros = np.atleast_1d(np.asarray(on_circle, complex))
    for zero in zeros:
        if abs(abs(zero) - 1) > ON_CIRCLE:
            raise ValueError(f"on_circle: needs zeros on the unit circle, received {zero:.6g}")
    check_pairs("on_circle", zeros)
    return zeros[np.imag(zeros) >= 0]


def _first_count(problem: ModelMatching, circle: Circle) -> int:
    """Taps from which on the samples are short, and as many as there are conditions."""
    sample, count = problem.one, 0
    while np.linalg.norm(sample) > FIRST and count < MOST_TAPS:
        sample, count = problem.shift @ sample, count + 1
    on_circle = int(np.sum(np.where(np.imag(circle) == 0, 1, 2)))
    return max(count, 2 * problem.zeros.size, 2) + on_circle


def _solved(conditions: _Conditions) -> tuple[Polynomial, Float[np.ndarray, " r"]]:
    """Taps and multipliers: the solver finds the basis, linear equations the digits."""
    rows, values = conditions.rows, conditions.values
    scale = max(float(np.max(np.abs(values), initial=0.0)), 1e-300)
    count = rows.shape[1]
    program = linprog(
        np.ones(2 * count),
        A_eq=np.concatenate([rows, -rows], axis=1),
        b_eq=values / scale,
        method="highs",
        options={"primal_feasibility_tolerance": TIGHT, "dual_feasibility_tolerance": TIGHT},
    )
    if not program.success:
        raise ValueError(f"taps: no filter of {count} taps meets the conditions")
    rough = scale * (program.x[:count] - program.x[count:])
    size = np.abs(rough).sum()
    basis = np.flatnonzero(np.abs(rough) > USED * size)
    taps = np.zeros(count)
    if basis.size:
        taps[basis] = np.linalg.lstsq(rows[:, basis], values, rcond=None)[0]
    multipliers = np.asarray(program.eqlin.marginals)
    short = np.sign(taps[basis]) - multipliers @ rows[:, basis]
    if basis.size:
        multipliers = multipliers + np.linalg.lstsq(rows[:, basis].T, short, rcond=None)[0]
    missed = np.max(np.abs(rows @ taps - values), initial=0.0)
    return (rough if missed > 1e-9 * scale else taps), multipliers
